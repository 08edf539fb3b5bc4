"""`pamjax validate`: test a model on recordings that its fit did not use."""

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
    """Test a model on recordings that its fit did not use.

    The report states for each block whether the prediction error is within the noise. It also states if the
    model was fitted to the same recording, because this is no independent test.

    Args:
        model: a model.json of `pamjax diagnose`, or a fit.json.
        cases: case folders, each with recording.csv and muscle.toml.
        case: name of the case, if a fit.json or model.json has several.
        json: print a JSON list with one document for each case.
    """
    from pamjax.compile.jax_cache import keep_compiled
    from pamjax.diagnosis.validate import read_training_checksums, validate
    from pamjax.infer.fitting.load import load_muscle
    from pamjax.records.case import read_case

    keep_compiled()
    loaded_muscle = load_muscle(model, case=case)
    fitted_checksums = read_training_checksums(model)
    validations = [validate(loaded_muscle, read_case(folder), fitted_checksums) for folder in cases]
    if json:
        print_json([validation.as_dict() for validation in validations])
    else:
        print_text("\n".join(str(validation) for validation in validations))
