"""An independent sizing with NumPy only: a grid that shrinks around its best point, without derivatives.

The muscle model is implemented again: neo-Hookean wall and linear threads. Energy slopes are central
differences; fixed-point steps solve the equilibrium of the threads. Only the spec entries are shared.
"""

import numpy as np

AMBIENT, BULGE, MAX_BURST_RATIO, MIN_BORE_RATIO = 101325.0, 3.5, 0.5, 0.3
SIDE, ROUNDS, SWEEPS = 7, 22, 5
#: Factor of the box width in each round, and its relative width at the start of each further sweep.
SHRINK, RESTART_WIDTH = 0.8, 0.15


def wall(length, thread, turns, outside, t, rest, shear):
    """Return energy of the rubber, J, hoop and radial stretch, volume, m³, and radius of the braid, m."""
    radius = np.sqrt(np.maximum(thread**2 - length**2, 1e-12)) / (2 * np.pi * turns)
    r_out, r_in = outside / 2, outside / 2 - t
    volume = np.pi * (r_out**2 - r_in**2) * rest
    along = length / rest
    inner = np.sqrt(np.maximum(radius**2 - (r_out**2 - r_in**2) / along, 1e-12))
    around = (radius + inner) / (r_in + r_out)
    through = 1 / (along * around)
    energy = volume * shear / 2 * (along**2 + around**2 + through**2 - 3)
    return energy, around, through, volume, radius


def muscle(x, build, contraction, shortening, pressure):
    """Return force, N, outer diameter, m, and the other outputs of one muscle at one operating point."""
    rest, angle, outside, t = x
    rest_thread = rest / np.sin(angle)
    turns = rest_thread * np.cos(angle) / (np.pi * outside)
    length = rest * (1 - contraction) - shortening
    stiffness = build.threads * build.thread_area * build.modulus
    h = 1e-6

    def energy(a, b):
        return wall(a, b, turns, outside, t, rest, build.shear)[0]

    thread = rest_thread
    for _ in range(6):
        rubber = (energy(length, thread * (1 + h)) - energy(length, thread * (1 - h))) / (2 * h * thread)
        load = pressure * length * thread / (2 * np.pi * turns**2) - rubber
        thread = rest_thread * (1 + np.clip(load, 0, None) / stiffness)
    pulled = (energy(length * (1 + h), thread) - energy(length * (1 - h), thread)) / (2 * h * length)
    force = pressure * (3 * length**2 - thread**2) / (4 * np.pi * turns**2) + pulled
    _, around, through, solid, radius = wall(length, thread, turns, outside, t, rest, build.shear)
    spacing = 4 * np.pi * length * radius / (build.threads * thread)
    return {
        "force": build.parallel * force,
        "diameter": 2 * radius + 2 * build.thread_diameter,
        "used": load / build.threads / (build.thread_area * build.strength),
        "fit": spacing / build.thread_diameter,
        "mesh": pressure * (spacing - build.thread_diameter) / (BULGE * build.shear * t * through),
        "strain": (around - 1) / build.elongation,
        "burst": pressure * length * rest_thread / (2 * np.pi * turns**2) / stiffness,
        "volume": length * (thread**2 - length**2) / (4 * np.pi * turns**2) - solid,
        "empty": rest * (rest_thread**2 - rest**2) / (4 * np.pi * turns**2) - solid,
        "slack": load,
    }


def merit(x, entries, build, supply):
    """Return ln(objective) and the largest violation at (n, 5) rest, angle, outside, wall, pressure."""
    rest, angle, outside, t, pressure = x.T
    dimensions = rest, angle, outside, t
    violations = [np.log(pressure / supply), MIN_BORE_RATIO - (1 - 2 * t / outside)]
    places = [(0.0, 0.0, supply, None)]
    places += [
        (demand.contraction or 0, demand.shortening or 0, demand.pressure or pressure, demand.at_least)
        for demand in entries.force
    ]
    if entries.stroke:
        for share in (0, 0.25, 0.5, 0.75, 1):
            moved = share * entries.stroke.length
            load = (entries.stroke.load or 0) + (entries.stroke.stiffness or 0) * moved
            places.append((0.0, moved, pressure, load))
    if entries.free_contraction is not None:
        places.append((entries.free_contraction, 0.0, pressure, 0.0))
    envelope = entries.envelope
    if envelope.length:
        violations.append(np.log(rest / (envelope.length - 2 * (envelope.fittings or 0))))
    widest, filled_volume = 0.0, 0.0
    for k, (contraction, shortening, at, load) in enumerate(places):
        outputs = muscle(dimensions, build, contraction, shortening, at)
        # This program does not model slack threads: it excludes such muscles.
        violations.append(np.where(outputs["slack"] > 0, -1.0, 1.0))
        violations += [
            np.log(np.maximum(outputs["used"] * entries.safety.thread, 1e-9)),
            outputs["mesh"] * entries.safety.mesh - 1,
            outputs["strain"] * entries.safety.rubber - 1,
            1 - outputs["fit"],
            outputs["burst"] / MAX_BURST_RATIO - 1,
        ]
        if envelope.diameter:
            violations.append(outputs["diameter"] / envelope.diameter - 1)
        if load is not None:
            violations.append((load - outputs["force"]) / max(load, 1.0))
        if k:
            widest = np.maximum(widest, outputs["diameter"])
            filled_volume = np.maximum(filled_volume, (at + AMBIENT) * outputs["volume"])
            rest_volume = outputs["empty"]
    violations.append(entries.limits.slenderness - rest / widest)
    objective = {
        "diameter": widest,
        "pressure": pressure,
        "air": build.parallel * (filled_volume - AMBIENT * rest_volume) / AMBIENT,
    }[entries.minimise]
    return np.log(np.maximum(objective, 1e-12)), np.max(np.broadcast_arrays(*violations), axis=0)


def best(entries, build, supply, low, high):
    """Return the best candidate of the grid search, (5,), its ln(objective) and its largest violation.

    Args:
        low, high: (5,) bounds of the first grid; all but the angle have a logarithmic scale.
    """
    logs = np.array([True, False, True, True, True])
    bounds = np.where(logs, np.log(low), low), np.where(logs, np.log(high), high)
    width, centre = bounds[1] - bounds[0], 0.5 * (bounds[0] + bounds[1])
    steps = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, SIDE)] * 5, indexing="ij"), -1).reshape(-1, 5)
    best_point = None
    for sweep in range(SWEEPS):
        # A grid cannot follow the ravine of a steep penalty: the penalty increases from sweep to sweep.
        weight = 30.0 * 2**sweep
        best_point = None
        width = (bounds[1] - bounds[0]) * (RESTART_WIDTH if sweep else 1.0)
        for _ in range(ROUNDS):
            c = np.clip(centre + steps * width, *bounds)
            with np.errstate(all="ignore"):
                value, violation = merit(np.where(logs, np.exp(c), c), entries, build, supply)
            score = np.where(
                np.isfinite(value + violation), value + weight * np.maximum(violation, 0), np.inf
            )
            k = int(np.argmin(score))
            if best_point is None or score[k] < best_point[0]:
                best_point, centre = (score[k], c[k], value[k], violation[k]), c[k]
            width = width * SHRINK
    _, c, value, violation = best_point
    return np.where(logs, np.exp(c), c), float(value), float(violation)
