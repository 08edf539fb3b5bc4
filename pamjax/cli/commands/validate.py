"""`pamjax validate`: hold a model against a recording that it never saw."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.options import Json
from pamjax.cli.screen import print_json, print_text


def validate(
    model: Path,
    cases: list[Path],
    /,
    *,
    case: str | None = None,
    json: Json = False,
) -> None:
    """Hold a model against recordings that it never saw, and say where it still fits.

    Args:
        model: a model.json of `pamjax diagnose`, or a fit.json.
        cases: case folders. A recording that the model was fitted to is told as no test.
        case: which case of a fit.json or model.json with several.
        json: print for programs, one document a case in a list.
    """
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.diagnosis.validate import read_training_checksums
    from pamjax.diagnosis.validate import validate_model as judge
    from pamjax.infer.fitting.load import load_muscle
    from pamjax.records.case import read_case

    keep_compiled()
    loaded = load_muscle(model, case=case)
    fitted_checksums = read_training_checksums(model)
    validations = [judge(loaded, read_case(folder), fitted_checksums) for folder in cases]
    if json:
        print_json([validation.as_dict() for validation in validations])
    else:
        print_text("\n".join(str(validation) for validation in validations))
