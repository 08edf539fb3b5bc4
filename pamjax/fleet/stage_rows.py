"""Rows of the tables of a fleet, from the result files of each stage of a case."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from pamjax.channels import to_display

#: Rows of each table, to which a stage appends.
Rows = dict[str, list[dict[str, Any]]]


def _read_fit(case: str, document: dict[str, Any], rows: Rows) -> dict[str, Any]:
    """Append the parameters of a fit, and return its entries in the row of the case."""
    rows["numbers"] += [
        {
            "case": case,
            "source": "fit",
            "name": name,
            "value": parameter["value"],
            "sd": parameter["sd"],
            "unit": parameter["unit"],
            "prior": parameter["prior"]["value"],
            "prior_sd": parameter["prior"]["sd"],
            "at_limit": parameter["at_limit"],
        }
        for name, parameter in document["parameters"].items()
    ]
    (case_entry,) = document["cases"].values()
    row = {"law": document["law"], "converged": document["converged"], "rows": case_entry["rows"]}
    for channel, unit in (("force", "N"), ("diameter", "mm"), ("length", "mm")):
        for column, key, table in (
            ("rmse", "value", case_entry["rmse"]),
            ("noise", "sd", case_entry["noise"]),
            ("held_out", "value", case_entry["held_out"].get("rmse", {})),
        ):
            row[f"{channel}_{column}_{unit}"] = table.get(channel, {}).get(key)
    return row


def _read_posterior(case: str, document: dict[str, Any], rows: Rows) -> dict[str, Any]:
    """Append mean and sd of the draws of each parameter, and return the entries of the case."""
    for name, parameter in document["parameters"].items():
        prior = parameter["prior"]
        row = {"value": parameter["mean"], "sd": parameter["sd"], "unit": parameter["unit"]}
        row |= {"prior": prior.get("value"), "prior_sd": prior.get("sd")}
        rows["numbers"].append({"case": case, "source": "sample", "name": name} | row)
    return {"sample_converged": document["converged"]}


def _read_validation(case: str, document: dict[str, Any], rows: Rows) -> dict[str, Any]:
    """Return the entries of a validation in the row of the case."""
    row = {
        "validation_blocks": len(document["blocks"]),
        "validation_blocks_within_noise": sum(block["fits"] for block in document["blocks"]),
        "validation_failed_rows": document["failed"],
        "validation_seen": document["seen"],
    }
    for channel, column in (("force", "force_validation_N"), ("diameter", "diameter_validation_mm")):
        if channel in document["rmse"]:
            row[column] = to_display(channel, document["rmse"][channel])
    return row


def _read_diagnosis(case: str, document: dict[str, Any], rows: Rows) -> dict[str, Any]:
    """Append mechanisms, their parameters and unexplained regions; return the entries of the case."""
    for mechanism in document["missing_physics"]:
        rows["mechanisms"].append(
            {
                "case": case,
                "id": mechanism["id"],
                "name": mechanism["name"],
                "probability": mechanism["probability"],
                "form_error": mechanism.get("form_error"),
                "indistinguishable_from": ", ".join(mechanism["indistinguishable_from"]) or None,
            }
        )
        rows["numbers"] += list(_list_mechanism_parameters(case, mechanism))
    rows["numbers"] += [
        _build_parameter_row(case, "diagnose", name, parameter)
        for name, parameter in document["baseline"]["parameters"].items()
    ]
    unexplained = document["unexplained"]
    rows["regions"] += [_build_region(case, region) for region in unexplained["where"]]
    likeness = unexplained.get("likeness") or [{}]
    return {
        "baseline_law": document["baseline"]["model"],
        "misfit_p_value": document["mismatch"]["p_value"],
        "misfit_detected": document["mismatch"]["detected"],
        "mechanisms": len(document["missing_physics"]),
        "unexplained": unexplained["detected"],
        "unexplained_share": unexplained["share"],
        "unexplained_like": likeness[0].get("id"),
    }


def _list_mechanism_parameters(case: str, mechanism: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for name, parameter in mechanism["parameters"].items():
        yield _build_parameter_row(case, "mechanism", f"{mechanism['id']}.{name}", parameter)


def _build_parameter_row(case: str, source: str, name: str, parameter: dict[str, Any]) -> dict[str, Any]:
    return {"case": case, "source": source, "name": name} | {k: parameter[k] for k in ("value", "sd", "unit")}


def _build_region(case: str, region: dict[str, Any]) -> dict[str, Any]:
    (pressure_low, pressure_high), (low, high) = region["pressure_kPa"], region["contraction"]
    return {
        "case": case,
        "channel": region["channel"],
        "direction": region["direction"],
        "pressure_low_kPa": pressure_low,
        "pressure_high_kPa": pressure_high,
        "contraction_low": low,
        "contraction_high": high,
        "share": region["share"],
    }


#: By stage: its result file, and the function that reads its rows.
STAGE_ROWS: dict[str, tuple[str, Callable[[str, dict[str, Any], Rows], dict[str, Any]]]] = {
    "fit": ("fit.json", _read_fit),
    "sample": ("posterior.json", _read_posterior),
    "diagnose": ("diagnosis.json", _read_diagnosis),
    "validate": ("validation.json", _read_validation),
}
