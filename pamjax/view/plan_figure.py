"""A plan, drawn: what to command over time, and how well the goal is known after each run."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pamjax.design.plan import ALL, Plan, sd_after
from pamjax.model.catalogue import meaning
from pamjax.units import in_unit, show
from pamjax.view.theme import DOUBLE, OKABE_ITO, QUIET, theme


def plan_figure(plan: Plan) -> Figure:
    """Pressure and length to command, and the goal's expected standard deviation run by run."""
    name = next(iter(plan.settled)) if plan.goal == ALL else plan.goal
    unit = meaning(name).show
    per = in_unit(unit)
    with theme():
        figure = Figure(figsize=(DOUBLE, 2.9), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.4, 1))
        table = plan.schedule()
        length = left.twinx()
        if len(table):
            gaps = np.flatnonzero(np.diff(table["cycle"].to_numpy()))
            cut = [
                np.insert(values.to_numpy(float), gaps + 1, np.nan)
                for values in (table["time [s]"] / 60, table["pressure [kPa]"], table["length [mm]"])
            ]
            left.plot(cut[0], cut[1], color=OKABE_ITO["blue"])
            length.plot(cut[0], cut[2], color=OKABE_ITO["orange"], linestyle="--")
        left.set(xlabel="time [min]", title=_commanded(plan))
        left.set_ylabel("pressure [kPa]", color=OKABE_ITO["blue"])
        length.set_ylabel("length [mm] (dashed)", color=OKABE_ITO["orange"])
        length.spines["right"].set_visible(True)
        done, sds = sd_after(plan, name)
        right.step(done, sds / per, where="post", color=OKABE_ITO["black"])
        right.plot(done[1:], sds[1:] / per, "o", color=OKABE_ITO["black"])
        if plan.wanted:
            right.axhline(plan.wanted / per, color=QUIET, linestyle=":", linewidth=0.8)
            right.annotate("wanted", (done[-1], plan.wanted / per), ha="right", va="bottom", color=QUIET)
        right.plot(done[-1], plan.isobars / per, "x", color=OKABE_ITO["vermilion"])
        right.annotate("ten isobars ", (done[-1], plan.isobars / per), ha="right", va="bottom",
                       color=OKABE_ITO["vermilion"])  # fmt: skip
        right.set_ylim(0, None)
        right.set(xlabel="minutes spent", ylabel=f"expected sd of {name} [{unit}]")
        right.set_title(f"{name} to ± {show(plan.settled[name].after, unit, 2)}")
    return figure


def _commanded(plan: Plan) -> str:
    checks = sum(count * run.minutes for count, run in plan.chosen if not run.pressure.size)
    return "What to command" + (f"; checks of the rig take {checks:.0f} min besides" if checks else "")
