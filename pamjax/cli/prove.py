"""`pamjax prove`: conceal known physics in simulated recordings, diagnose them, open the envelopes, score."""

from __future__ import annotations

from pathlib import Path

from pamjax.cli.screen import say, say_written, working, writable


def prove(
    *,
    out: Path = Path("out"),
    nothing: int = 1,
    single: int = 2,
    pair: int = 0,
    triple: int = 0,
    outside: int = 1,
    correlation: float = 0.0,
    seed: int = 0,
) -> None:
    """Conceal known physics in simulated recordings, diagnose them, open the envelopes, score.

    Writes prove.json after every recording: a run that was stopped goes on where it was.

    Args:
        out: folder to write to.
        nothing: how many recordings with nothing concealed.
        single: with one effect.
        pair: with two.
        triple: with three.
        outside: with something that is in no catalogue.
        correlation: of neighbouring samples of noise, 0 to 0.95.
        seed: of everything that is drawn.
    """
    from pamjax.check import refuse

    counts = {"nothing": nothing, "single": single, "pair": pair, "triple": triple, "outside": outside}
    for name, count in counts.items():
        if count < 0:
            raise refuse(f"`{name}` must be at least 0", f"{count}")
    if not 0 <= correlation <= 0.95:
        raise refuse("`correlation` must lie between 0 and 0.95", f"{correlation:g}")
    writable(out)
    out.mkdir(parents=True, exist_ok=True)
    from pamjax.infer.cache import keep_compiled
    from pamjax.study.prove import prove as run
    from pamjax.study.prove import table

    keep_compiled()
    with working() as progress:
        trials = run(counts, out / "prove.json", correlation=correlation, seed=seed, progress=progress)
    say(table(trials))
    for trial in trials:
        if trial.kind != "nothing":
            said = ", ".join(trial.named) or ("unexplained" if trial.unexplained else "nothing")
            say(f"  {trial.kind} {trial.number + 1}: {', '.join(trial.concealed)} -> {said}")
    say_written([out / "prove.json"])
