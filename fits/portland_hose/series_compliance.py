"""Compliance in series with five hoses of one bench: does it belong to the rig or to the hose?

python fits/portland_hose/series_compliance.py FOLDER_WITH_CASES --out out/portland_hose

A diagnosis names a compliance in series with the hose, but one recording cannot distinguish soft threads
from a compliant rig. Hoses of several lengths can. A rig yields by the same millimetres for every hose;
threads yield by the same share of the length. Each hose is fitted alone with wall, relaxation and rig.
Both hypotheses are tested for the two parameters of the rig: chi² about the weighted mean of all hoses. A
large chi² contradicts the hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from command_line import build_parser
from shared_wall import average_values, read_hose

from pamjax.compile.jax_cache import keep_compiled
from pamjax.infer.fitting.fit import fit
from pamjax.infer.fitting.result import Estimate

#: Hoses of the same bore and bench, and the mechanisms that are fitted to each.
HOSES = ("hose-10mm-83", "hose-10mm-132", "hose-10mm-257", "hose-10mm-281", "hose-10mm-521")
MECHANISMS = ("bladder_elasticity", "viscoelastic_creep", "rig_compliance")


@dataclass(frozen=True)
class SeriesCompliance:
    """Estimates of one hose.

    Attributes:
        length: at rest, m.
        seat, compliance: parameters of the rig, m and m/N.
        modulus: of wall and relaxation together, Pa.
        rmse: of force, N.
    """

    length: float
    seat: Estimate
    compliance: Estimate
    modulus: float
    rmse: float


def fit_compliance(folder: Path) -> SeriesCompliance:
    """Return the estimates of one hose."""
    case = read_hose(folder)
    result = fit([case], "inelastic", (), MECHANISMS, starts=2)
    seat, compliance = (result.estimates[f"rig_compliance.{name}"] for name in ("seat", "compliance"))
    modulus = sum(result.estimates[f"{id}.modulus"].value for id in MECHANISMS[:2])
    return SeriesCompliance(
        case.muscle_toml.rest_length.value, seat, compliance, modulus, result.cases[0].rmse["force"]
    )


def format_hypothesis(name: str, values: list[tuple[float, float]], unit: str) -> str:
    """Return the agreement of all hoses under one hypothesis, as a row of a table."""
    average = average_values(values)
    return (
        f"| {name} | {average.mean:.3g} ± {average.sd:.2g} {unit} | {average.chi2:.2g}"
        f" | {average.p_value:.2g} |"
    )


def format_report(results: dict[str, SeriesCompliance]) -> str:
    """Return all hoses and the four hypotheses as Markdown."""
    lines = ["| hose | seat, mm | compliance, mm/kN | moduli, MPa | rmse, N |", "|---|---|---|---|---|"]
    for name, result in results.items():
        seat, compliance = result.seat, result.compliance
        lines.append(
            f"| {name.removeprefix('hose-')} | {1e3 * seat.value:.2f} ± {1e3 * (seat.sd or 0):.2f}"
            f" | {1e6 * compliance.value:.1f} ± {1e6 * (compliance.sd or 0):.1f}"
            f" | {result.modulus / 1e6:.2f} | {result.rmse:.2f} |"
        )
    lines += ["", f"| equal in all {len(results)} hoses | mean | chi² | p |", "|---|---|---|---|"]
    for name, unit, scale in (("seat", "mm", 1e3), ("compliance", "mm/kN", 1e6)):
        values = [
            (scale * getattr(r, name).value, scale * getattr(r, name).sd, r.length) for r in results.values()
        ]
        lines.append(format_hypothesis(f"{name} of the rig", [(v, sd) for v, sd, _ in values], unit))
        shares = [(v / (1e3 * length) * 100, sd / (1e3 * length) * 100) for v, sd, length in values]
        lines.append(format_hypothesis(f"{name} per length of hose", shares, unit.replace("mm", "%")))
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    options = build_parser(__doc__).parse_args(arguments)
    keep_compiled()
    options.out.mkdir(parents=True, exist_ok=True)
    text = format_report({name: fit_compliance(options.cases / name) for name in HOSES})
    (options.out / "series_compliance.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
