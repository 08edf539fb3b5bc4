"""An independent sizing: NumPy alone, no derivative, no solver, a grid that closes in on its best.

The muscle is written out again from its geometry: neo-Hookean wall and linear threads, their energy slopes by
central differences, the thread's balance by fixed-point steps. Only what the spec's words mean is shared.
"""

import numpy as np

AMBIENT, BULGE, MOST_BURST, LEAST_BORE = 101325.0, 3.5, 0.5, 0.3
SIDE, ROUNDS, SWEEPS = 7, 22, 5
#: How a box shrinks each round, and how wide it is again at each further sweep.
SHRINK, AGAIN = 0.8, 0.15


def wall(length, thread, turns, outside, t, rest, shear):
    """Energy of the rubber, J, its stretch around and through, its volume, m³, and the braid's radius, m."""
    radius = np.sqrt(np.maximum(thread**2 - length**2, 1e-12)) / (2 * np.pi * turns)
    r_out, r_in = outside / 2, outside / 2 - t
    volume = np.pi * (r_out**2 - r_in**2) * rest
    along = length / rest
    inner = np.sqrt(np.maximum(radius**2 - (r_out**2 - r_in**2) / along, 1e-12))
    around = (radius + inner) / (r_in + r_out)
    through = 1 / (along * around)
    energy = volume * shear / 2 * (along**2 + around**2 + through**2 - 3)
    return energy, around, through, volume, radius


def muscle(x, made, contraction, shortening, pressure):
    """Force of one muscle, N, outer diameter, m, and what the assumptions look at, at one place each."""
    rest, angle, outside, t = x
    rest_thread = rest / np.sin(angle)
    turns = rest_thread * np.cos(angle) / (np.pi * outside)
    length = rest * (1 - contraction) - shortening
    stiffness = made.threads * made.thread_area * made.modulus
    h = 1e-6

    def energy(a, b):
        return wall(a, b, turns, outside, t, rest, made.shear)[0]

    thread = rest_thread
    for _ in range(6):
        rubber = (energy(length, thread * (1 + h)) - energy(length, thread * (1 - h))) / (2 * h * thread)
        load = pressure * length * thread / (2 * np.pi * turns**2) - rubber
        thread = rest_thread * (1 + np.clip(load, 0, None) / stiffness)
    pulled = (energy(length * (1 + h), thread) - energy(length * (1 - h), thread)) / (2 * h * length)
    force = pressure * (3 * length**2 - thread**2) / (4 * np.pi * turns**2) + pulled
    _, around, through, solid, radius = wall(length, thread, turns, outside, t, rest, made.shear)
    spacing = 4 * np.pi * length * radius / (made.threads * thread)
    return {
        "force": made.parallel * force,
        "diameter": 2 * radius + 2 * made.thread_diameter,
        "used": load / made.threads / (made.thread_area * made.strength),
        "fit": spacing / made.thread_diameter,
        "mesh": pressure * (spacing - made.thread_diameter) / (BULGE * made.shear * t * through),
        "strain": (around - 1) / made.elongation,
        "burst": pressure * length * rest_thread / (2 * np.pi * turns**2) / stiffness,
        "volume": length * (thread**2 - length**2) / (4 * np.pi * turns**2) - solid,
        "empty": rest * (rest_thread**2 - rest**2) / (4 * np.pi * turns**2) - solid,
        "slack": load,
    }


def merit(x, words, made, supply):
    """ln(objective) and the largest broken margin at (n, 5) rest, angle, outside, wall, pressure."""
    rest, angle, outside, t, pressure = x.T
    one = rest, angle, outside, t
    broken = [np.log(pressure / supply), LEAST_BORE - (1 - 2 * t / outside)]
    places = [(0.0, 0.0, supply, None)]
    places += [
        (pull.contraction or 0, pull.shortening or 0, pull.pressure or pressure, pull.at_least)
        for pull in words.force
    ]
    if words.stroke:
        for share in (0, 0.25, 0.5, 0.75, 1):
            moved = share * words.stroke.length
            load = (words.stroke.load or 0) + (words.stroke.stiffness or 0) * moved
            places.append((0.0, moved, pressure, load))
    if words.free_contraction is not None:
        places.append((words.free_contraction, 0.0, pressure, 0.0))
    room = words.envelope
    if room.length:
        broken.append(np.log(rest / (room.length - 2 * (room.fittings or 0))))
    widest, filled = 0.0, 0.0
    for k, (contraction, shortening, at, load) in enumerate(places):
        got = muscle(one, made, contraction, shortening, at)
        # A slack thread is beyond this program: such a muscle is not one of its answers.
        broken.append(np.where(got["slack"] > 0, -1.0, 1.0))
        broken += [
            np.log(np.maximum(got["used"] * words.safety.thread, 1e-9)),
            got["mesh"] * words.safety.mesh - 1,
            got["strain"] * words.safety.rubber - 1,
            1 - got["fit"],
            got["burst"] / MOST_BURST - 1,
        ]
        if room.diameter:
            broken.append(got["diameter"] / room.diameter - 1)
        if load is not None:
            broken.append((load - got["force"]) / max(load, 1.0))
        if k:
            widest = np.maximum(widest, got["diameter"])
            filled = np.maximum(filled, (at + AMBIENT) * got["volume"])
            empty = got["empty"]
    broken.append(words.limits.slenderness - rest / widest)
    objective = {
        "diameter": widest,
        "pressure": pressure,
        "air": made.parallel * (filled - AMBIENT * empty) / AMBIENT,
    }[words.minimise]
    return np.log(np.maximum(objective, 1e-12)), np.max(np.broadcast_arrays(*broken), axis=0)


def best(words, made, supply, low, high):
    """The best candidate a grid finds, (5,), its ln(objective) and its largest broken margin.

    Args:
        low, high: (5,) ends of the first grid; all but the angle are searched by their logarithm.
    """
    logs = np.array([True, False, True, True, True])
    at = np.where(logs, np.log(low), low), np.where(logs, np.log(high), high)
    width, centre = at[1] - at[0], 0.5 * (at[0] + at[1])
    steps = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, SIDE)] * 5, indexing="ij"), -1).reshape(-1, 5)
    found = None
    for sweep in range(SWEEPS):
        # A steep price of a broken margin makes a ravine that a grid cannot follow: it rises sweep by sweep.
        weight = 30.0 * 2**sweep
        found = None
        width = (at[1] - at[0]) * (AGAIN if sweep else 1.0)
        for _ in range(ROUNDS):
            c = np.clip(centre + steps * width, *at)
            with np.errstate(all="ignore"):
                value, broken = merit(np.where(logs, np.exp(c), c), words, made, supply)
            score = np.where(np.isfinite(value + broken), value + weight * np.maximum(broken, 0), np.inf)
            k = int(np.argmin(score))
            if found is None or score[k] < found[0]:
                found, centre = (score[k], c[k], value[k], broken[k]), c[k]
            width = width * SHRINK
    _, c, value, broken = found
    return np.where(logs, np.exp(c), c), float(value), float(broken)
