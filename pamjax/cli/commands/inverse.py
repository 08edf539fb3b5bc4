"""`pamjax inverse`: which pressure or length to command, and the same as a table for a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pamjax.cli.screen import check_writable, print_json, print_text, print_written_files


def inverse(
    muscle: Path,
    /,
    *,
    force: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    length: str | None = None,
    pressure: str | None = None,
    posterior: Path | None = None,
    highest: str | None = None,
    export: Path | None = None,
    law: str | None = None,
    case: str | None = None,
    seed: int = 0,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Say which pressure (or length) gives a wanted force; export the inverse for a robot without JAX.

    Args:
        muscle: a fit.json or model.json, or a case folder or muscle.toml (the muscle as stated).
        force: wanted, as "300 N"; with `--length` the pressure is found, with `--pressure` the length.
        length: at which, as "210 mm".
        pressure: at which, as "400 kPa".
        posterior: a posterior.nc of the same recording: how sure the answer is, draw by draw, at their mean.
        highest: pressure there is; the highest calibrated one, or 600 kPa, if left out.
        export: folder for controller.npz and controller.py, which need NumPy alone.
        law: thread law of a muscle as stated; its baseline if left out.
        case: which case of a fit.json or model.json with several.
        seed: of the random points at which an exported table is measured.
        json: print the answer as JSON.
    """
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.errors import refuse
    from pamjax.units import parse_quantity

    has_wish = force is not None and (length is None) != (pressure is None)
    if not has_wish and (export is None or force or length or pressure):
        rule = "an inverse takes `--force` with `--length` or with `--pressure`, or `--export`"
        raise refuse(rule, remedy='Write --force "300 N" --length "210 mm".')
    if export is not None:
        check_writable(export, "`--export`")
    keep_compiled()
    from pamjax.control.command import solve_command
    from pamjax.control.inverse import DEFAULT_PRESSURES
    from pamjax.control.inverse import inverse as invert
    from pamjax.infer.fitting.load import load_muscle

    loaded, draws = load_muscle(muscle, law, case), None
    if posterior is not None:
        from pamjax.control.posterior_draws import load_draws

        draws = load_draws(posterior, loaded)
        loaded = draws.loaded
    calibrated_pressures = loaded.calibrated_range.get("pressure", DEFAULT_PRESSURES)
    max_pressure = parse_quantity(highest, "pressure", "--highest") if highest else calibrated_pressures[1]
    muscle_inverse = invert(loaded, (min(calibrated_pressures[0], 0.0), max_pressure))
    if has_wish and force is not None:
        command = solve_command(
            muscle_inverse,
            parse_quantity(force, "force", "--force"),
            length=parse_quantity(length, "length", "--length") if length else None,
            pressure=parse_quantity(pressure, "pressure", "--pressure") if pressure else None,
            file=muscle if muscle.suffix == ".json" else None,
            case=case,
            draws=draws,
            calibrated_range=loaded.calibrated_range,
        )
        print_json(command.as_dict()) if json else print_text(str(command))
    if export is not None:
        from pamjax.control.command_uncertainty import combine_force_sd
        from pamjax.control.export import export as write

        force_uncertainty = combine_force_sd(muscle, case, draws.compute_force_sd if draws else None)
        written = write(muscle_inverse, export, force_sd=force_uncertainty, seed=seed)
        if not json:
            print_text(str(written))
        print_written_files(list(written.files))
