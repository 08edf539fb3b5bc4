"""Where hoses of one bench are soft at low force: in the rig that holds them, or in the hose itself.

python fits/portland_hose/soft.py FOLDER_WITH_CASES --out out/portland_hose

Beside the wall and its relaxation a diagnosis finds something soft in series with a hose, and cannot tell
soft threads from a rig that gives. Hoses of several lengths can: a rig gives by the same millimetres whatever
hangs in it, threads by the same share of their length. Each hose is fitted alone with wall, relaxation and
rig, and of the rig's two numbers both readings are held against all hoses: χ² about their weighted mean, of
which a large one refutes the reading.
"""

from __future__ import annotations

from dataclasses import dataclass

from together import agreement, believed
from words import taker

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.result import Estimate

#: Hoses of the same bore and bench, and what is fitted to each.
HOSES = ("hose-10mm-83", "hose-10mm-132", "hose-10mm-257", "hose-10mm-281", "hose-10mm-521")
WITH = ("bladder_elasticity", "viscoelastic_creep", "rig_compliance")


@dataclass(frozen=True)
class Softness:
    """What one hose says.

    Attributes:
        length: m.
        seat, compliance: of what is soft, m and m/N.
        modulus: of wall and relaxation together, Pa.
        rmse: of force, N.
    """

    length: float
    seat: Estimate
    compliance: Estimate
    modulus: float
    rmse: float


def softness(folder) -> Softness:
    """Fit one hose."""
    case = believed(folder)
    one = fit([case], "inelastic", (), WITH, starts=2)
    seat, compliance = (one.estimates[f"rig_compliance.{name}"] for name in ("seat", "compliance"))
    modulus = sum(one.estimates[f"{id}.modulus"].value for id in WITH[:2])
    return Softness(case.entry.rest_length.value, seat, compliance, modulus, one.cases[0].rmse["force"])


def reading(what: str, values: list[tuple[float, float]], unit: str) -> str:
    """How well one reading agrees over all hoses, as a row of a table."""
    mean, sd, squares, p = agreement(values)
    return f"| {what} | {mean:.3g} ± {sd:.2g} {unit} | {squares:.2g} | {p:.2g} |"


def report(found: dict[str, Softness]) -> str:
    """All hoses and the four readings, as Markdown."""
    lines = ["| hose | seat, mm | compliance, mm/kN | moduli, MPa | rmse, N |", "|---|---|---|---|---|"]
    for name, one in found.items():
        seat, compliance = one.seat, one.compliance
        lines.append(
            f"| {name.removeprefix('hose-')} | {1e3 * seat.value:.2f} ± {1e3 * (seat.sd or 0):.2f}"
            f" | {1e6 * compliance.value:.1f} ± {1e6 * (compliance.sd or 0):.1f}"
            f" | {one.modulus / 1e6:.2f} | {one.rmse:.2f} |"
        )
    lines += ["", f"| the same in all {len(found)} | mean | χ² | p |", "|---|---|---|---|"]
    for what, unit, scale in (("seat", "mm", 1e3), ("compliance", "mm/kN", 1e6)):
        told = [
            (scale * getattr(s, what).value, scale * getattr(s, what).sd, s.length) for s in found.values()
        ]
        lines.append(reading(f"{what}, as of a rig", [(v, sd) for v, sd, _ in told], unit))
        shares = [(v / (1e3 * at) * 100, sd / (1e3 * at) * 100) for v, sd, at in told]
        lines.append(reading(f"{what}, as a share of length", shares, unit.replace("mm", "%")))
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    asked = taker(__doc__).parse_args(arguments)
    keep_compiled()
    asked.out.mkdir(parents=True, exist_ok=True)
    told = report({name: softness(asked.cases / name) for name in HOSES})
    (asked.out / "soft.md").write_text(told + "\n", encoding="utf-8")
    print(told)


if __name__ == "__main__":
    main()
