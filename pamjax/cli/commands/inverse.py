"""`pamjax inverse`: compute the pressure or length for a wanted force, or export a table of it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pamjax.cli.overwrite import check_replaceable
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
    """Compute the pressure or length for a wanted force, or export a table for a controller.

    With `--force` and `--length` the result is the pressure. With `--force` and `--pressure` it is the
    length. The result has a standard deviation if the muscle was fitted or sized. Otherwise it states
    that none is known.

    Args:
        muscle: a fit.json or model.json of a fitted muscle, or a case folder or muscle.toml with stated
            values.
        force: wanted force, such as "300 N".
        length: muscle length, such as "210 mm".
        pressure: gauge pressure, such as "400 kPa".
        posterior: a posterior.nc of the same recording; the command then uses the posterior mean and prints
            an interval from the draws.
        highest: highest available pressure; by default the highest calibrated one, or 600 kPa.
        export: folder for controller.npz and controller.py, which need only NumPy.
        law: thread law of a muscle with stated values; by default that of its baseline model.
        case: name of the case, if a fit.json or model.json has several.
        seed: random seed for the points at which the error of an exported table is measured.
        json: print one JSON document.
    """
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.errors import BadInput
    from pamjax.units import parse_quantity

    has_request = force is not None and (length is None) != (pressure is None)
    if not has_request and (export is None or force or length or pressure):
        rule = "`pamjax inverse` needs `--force` with `--length` or with `--pressure`, or `--export`"
        raise BadInput.from_rule(rule, remedy='Write --force "300 N" --length "210 mm".')
    if export is not None:
        check_writable(export, "`--export`")
        check_replaceable(export, ["controller.npz", "controller.py"], "`--export`")
    keep_compiled()
    from pamjax.control.command import solve_command
    from pamjax.control.inverse import DEFAULT_PRESSURES
    from pamjax.control.inverse import inverse as invert
    from pamjax.infer.fitting.load import load_muscle

    loaded_muscle, draws = load_muscle(muscle, law, case), None
    if posterior is not None:
        from pamjax.control.posterior_draws import load_draws

        draws = load_draws(posterior, loaded_muscle)
    neglected = list(loaded_muscle.form_errors.forms if loaded_muscle.form_errors else ())
    if draws is not None:
        neglected += draws.neglected_form_errors
        loaded_muscle = draws.mean_muscle
    if neglected:
        _warn_of_form_errors(list(dict.fromkeys(neglected)), muscle, case)
    if muscle.suffix != ".json" and draws is None:
        print(
            f"pamjax: note: the values of {muscle} are as stated, not fitted."
            " For fitted values, name the fit.json of `pamjax fit` instead.",
            file=sys.stderr,
        )
    calibrated_pressures = loaded_muscle.calibrated_range.get("pressure", DEFAULT_PRESSURES)
    max_pressure = parse_quantity(highest, "pressure", "--highest") if highest else calibrated_pressures[1]
    muscle_inverse = invert(loaded_muscle, (min(calibrated_pressures[0], 0.0), max_pressure))
    if has_request and force is not None:
        command = solve_command(
            muscle_inverse,
            parse_quantity(force, "force", "--force"),
            length=parse_quantity(length, "length", "--length") if length else None,
            pressure=parse_quantity(pressure, "pressure", "--pressure") if pressure else None,
            file=muscle if muscle.suffix == ".json" else None,
            case=case,
            draws=draws,
            calibrated_range=loaded_muscle.calibrated_range,
        )
        print_json(command.as_dict()) if json else print_text(str(command))
    if export is not None:
        from pamjax.control.command_uncertainty import combine_force_sd, find_uncertainty_source
        from pamjax.control.export import export as write

        force_uncertainty = combine_force_sd(muscle, case, draws.compute_force_sd if draws else None)
        source = find_uncertainty_source(muscle, draws is not None)
        exported_controller = write(
            muscle_inverse, export, force_sd=force_uncertainty, uncertainty=source, seed=seed
        )
        if not json:
            print_text(str(exported_controller))
        print_written_files(list(exported_controller.files))


def _warn_of_form_errors(ids: list[str], file: Path, case: str | None) -> None:
    """Warn that the command neglects form errors, and state whether its uncertainty includes them."""
    from pamjax.control.command_uncertainty import read_unexplained_force
    from pamjax.text import join_words

    verb = "excludes" if read_unexplained_force(file, case) is None else "includes"
    print(
        f"pamjax: warning: the command follows the equation of {join_words(ids)} and neglects the form error,"
        f" the estimated difference from the equation; a stated ± {verb} this difference",
        file=sys.stderr,
    )
