"""`pamjax inverse`: a fitted muscle is commanded, with how sure it is, and exported."""

import json

import numpy as np
import pytest

from pamjax.cli.main import main
from pamjax.design.doubt import force_sd
from pamjax.design.standalone import Controller
from pamjax.infer.load import load_muscle


def test_a_fitted_muscle_is_commanded_with_its_doubt(fitted, capsys):
    words = [str(fitted / "fit.json"), "--force", "300 N", "--length", "180 mm"]
    assert main(["inverse", *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["command"], found["limit"]) == ("pressure", "OK")
    assert 0 < found["sd"] < 0.05 * found["value"]
    muscle = load_muscle(fitted / "fit.json").muscle
    assert float(muscle(found["value"], 0.18).force) == pytest.approx(300.0, rel=1e-9)
    assert main(["inverse", *words]) == 0
    said = capsys.readouterr().out
    assert " ± " in said
    assert "for a newton more" in said


def test_doubt_is_that_of_draws_from_the_covariance(fitted):
    document = json.loads((fitted / "fit.json").read_text())
    names = document["correlation"]["names"]
    sd = np.array([document["parameters"][n]["sd"] for n in names])
    root = np.linalg.cholesky(np.array(document["correlation"]["matrix"]) + 1e-9 * np.eye(len(names)))
    to_si = {"mm": 1e-3, "GPa": 1e9, "1": 1.0}
    scale = np.array([to_si[document["parameters"][n]["unit"]] for n in names])
    case = document["cases"][next(iter(document["cases"]))]
    rng, forces = np.random.default_rng(0), []
    from pamjax.model.assembly import assemble

    for _ in range(120):
        moved = 0.2 * sd * scale * (root @ rng.standard_normal(sd.size))
        numbers = case["muscle"]["numbers"] | {
            n: case["muscle"]["numbers"][n] + step for n, step in zip(names, moved, strict=True)
        }
        forces.append(float(assemble(case["muscle"]["law"], numbers)(300e3, 0.18).force))
    told = force_sd(fitted / "fit.json", np.array([300e3]), np.array([0.18]))[0]
    # A hundred and twenty draws know a standard deviation to 6.5 %.
    assert np.std(forces) / 0.2 == pytest.approx(told, rel=0.25)


def test_what_cannot_be_met_is_an_answer(fitted, capsys):
    assert main(["inverse", str(fitted / "fit.json"), "--force", "9 kN", "--pressure", "400 kPa"]) == 0
    assert "cannot be met: more force than there is" in capsys.readouterr().out


def test_an_export_says_how_far_it_is_off(fitted, tmp_path, capsys):
    assert main(["inverse", str(fitted / "fit.json"), "--export", str(tmp_path)]) == 0
    assert "off by less than pressure" in capsys.readouterr().out
    robot = Controller(tmp_path / "controller.npz")
    pressure, status = robot.pressure(300.0, 0.18)
    assert status == 0
    force = load_muscle(fitted / "fit.json").muscle(float(pressure), 0.18).force
    assert float(force) == pytest.approx(300.0, rel=1e-3)


@pytest.mark.parametrize("words", [[], ["--force", "3 N"], ["--force", "3 N", "--export", "x"]])
def test_half_a_wish_is_refused(fitted, capsys, words):
    assert main(["inverse", str(fitted / "fit.json"), *words]) == 2
    assert "`--force` with `--length` or with `--pressure`" in capsys.readouterr().err
