"""`pamjax inverse`: which pressure or length to command, and the same as a table for a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pamjax.cli.screen import say, say_json, say_written, writable


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
    from pamjax.units import parse

    asked = force is not None and (length is None) != (pressure is None)
    if not asked and (export is None or force or length or pressure):
        rule = "an inverse takes `--force` with `--length` or with `--pressure`, or `--export`"
        raise refuse(rule, remedy='Write --force "300 N" --length "210 mm".')
    if export is not None:
        writable(export, "`--export`")
    keep_compiled()
    from pamjax.control.command import answer
    from pamjax.control.inverse import PRESSURES
    from pamjax.control.inverse import inverse as invert
    from pamjax.infer.fitting.load import load_muscle

    loaded, draws = load_muscle(muscle, law, case), None
    if posterior is not None:
        from pamjax.control.posterior_draws import draws_of

        draws = draws_of(posterior, loaded)
        loaded = draws.loaded
    known = loaded.calibrated.get("pressure", PRESSURES)
    top = parse(highest, "pressure", "--highest") if highest else known[1]
    of = invert(loaded, (min(known[0], 0.0), top))
    if asked and force is not None:
        found = answer(
            of,
            parse(force, "force", "--force"),
            length=parse(length, "length", "--length") if length else None,
            pressure=parse(pressure, "pressure", "--pressure") if pressure else None,
            file=muscle if muscle.suffix == ".json" else None,
            case=case,
            draws=draws,
            calibrated=loaded.calibrated,
        )
        say_json(found.as_dict()) if json else say(str(found))
    if export is not None:
        from pamjax.control.command_uncertainty import doubt_of
        from pamjax.control.export import export as write

        doubt = doubt_of(muscle, case, draws.force_sd if draws else None)
        written = write(of, export, doubt=doubt, seed=seed)
        if not json:
            say(str(written))
        say_written(list(written.files))
