"""A store whose results are invented: one fit, and on request one diagnosis, for each specimen."""

import datetime
import json

from pamjax.fleet.plan import FleetCase, FleetPlan
from pamjax.fleet.store import FleetStore, TaskOutcome, open_stage_folder, write_outcome
from pamjax.records.reading.specimen import Specimen

FIRST_DAY = datetime.date(2026, 3, 2)


def write_made_store(
    folder,
    values,
    *,
    sd=0.5,
    prior=(100.0, 20.0),
    benches=None,
    mechanisms=None,
    names=None,
    limits=(),
    serials=None,
    types=None,
    copies=None,
):
    """Write a store, and return its folder.

    Args:
        folder: the folder.
        values: estimate of `thread.modulus` in GPa of each specimen.
        sd, prior: its sd, and mean and sd of its prior; for the prior also a list with one for each.
        benches: bench of each specimen.
        mechanisms: list of mechanism ids of each specimen; None for no diagnosis.
        names: names of the cases.
        limits: indices of the specimens whose number is at its limit.
        serials, types: serial number and type of each specimen.
        copies: by index of a copy, the index of its original, which has the same checksum.
    """
    names = names or [f"case-{k:02d}" for k in range(len(values))]
    days = [FIRST_DAY + datetime.timedelta(days=7 * k) for k in range(len(names))]
    serials = serials or [f"A-{k:03d}" for k in range(len(names))]
    types = types or ["made"] * len(names)
    origins = [
        Specimen(benches[k] if benches else None, serials[k], types[k], day) for k, day in enumerate(days)
    ]
    priors = prior if isinstance(prior, list) else [prior] * len(names)
    cases = [
        FleetCase(name, folder / name, origins[k], f"{(copies or {}).get(k, k):064x}")
        for k, name in enumerate(names)
    ]
    stages = ("fit",) if mechanisms is None else ("fit", "diagnose")
    plan, store = FleetPlan("made", folder, tuple(cases), stages), FleetStore(folder)
    store.prepare()
    store.write_plan(plan)
    for k, case in enumerate(cases):
        for task in store.list_tasks(plan, case):
            is_fit = task.stage == "fit"
            document = (
                build_fit(values[k], sd, priors[k], k in limits) if is_fit else build_diagnosis(mechanisms[k])
            )
            with open_stage_folder(task) as place:
                (place / ("fit.json" if is_fit else "diagnosis.json")).write_text(json.dumps(document))
                (place / "report.html").write_text("<p>made</p>")
                write_outcome(place, task, TaskOutcome(task.key, "done", "", 1.0 + k))
    return folder


def build_fit(value, sd, prior, at_limit=False):
    """Return a fit.json with one number and one channel."""
    number = {"value": value, "sd": sd, "unit": "GPa", "at_limit": at_limit}
    force = {"value": 1.1, "unit": "N"}
    entry = {"rows": 3, "rmse": {"force": force}, "noise": {"force": {"sd": 2.0}}, "held_out": {}}
    parameters = {"thread.modulus": number | {"prior": dict(zip(("value", "sd"), prior, strict=True))}}
    return {"law": "elastic", "converged": True, "parameters": parameters, "cases": {"made": entry}}


def build_diagnosis(mechanisms):
    """Return a diagnosis.json with mechanisms; "unexplained" adds unexplained misfit."""
    region = {
        "channel": "force",
        "direction": "lengthening",
        "pressure_kPa": [100.0, 300.0],
        "contraction": [0.0, 0.1],
        "share": 1.0,
    }
    unexplained = "unexplained" in mechanisms
    return {
        "baseline": {"model": "elastic", "parameters": {}},
        "mismatch": {"p_value": 1e-9 if mechanisms else 0.5, "detected": bool(mechanisms)},
        "missing_physics": [
            {
                "id": name,
                "name": name,
                "probability": 0.97,
                "form_error": None,
                "indistinguishable_from": [],
                "parameters": {"gain": {"value": 1.06, "sd": 0.01, "unit": "1"}},
            }
            for name in mechanisms
            if name != "unexplained"
        ],
        "unexplained": {
            "detected": unexplained,
            "share": 0.4 if unexplained else 0.0,
            "likeness": [{"id": "eccentric_mount"}] if unexplained else [],
            "where": [region] if unexplained else [],
        },
    }
