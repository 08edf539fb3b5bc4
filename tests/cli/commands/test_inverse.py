"""`pamjax inverse`: commands for a fitted muscle, their uncertainty, and export of a table."""

import json
import math

import numpy as np
import pytest
import xarray as xr

from pamjax.cli.main import main
from pamjax.control.command_uncertainty import compute_force_sd
from pamjax.control.posterior_draws import DRAW_COUNT
from pamjax.control.standalone import Controller
from pamjax.infer.fitting.load import load_muscle
from pamjax.units import compute_si_factor, format_quantity


def test_command_of_a_fitted_muscle_has_an_uncertainty(fitted, capsys):
    words = [str(fitted / "fit.json"), "--force", "300 N", "--length", "180 mm"]
    assert main(["inverse", *words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["command"], document["limit"]) == ("pressure", "OK")
    assert 0 < document["sd"] < 0.05 * document["value"]
    muscle = load_muscle(fitted / "fit.json").muscle
    assert float(muscle(document["value"], 0.18).force) == pytest.approx(300.0, rel=1e-9)
    assert main(["inverse", *words]) == 0
    printed = capsys.readouterr().out
    assert " ± " in printed
    assert " kPa per N" in printed


@pytest.mark.slow
def test_uncertainty_agrees_with_draws_from_the_covariance(fitted):
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
    computed_sd = compute_force_sd(fitted / "fit.json", np.array([300e3]), np.array([0.18]))[0]
    # An sd from 120 draws has a standard error of 6.5 %.
    assert np.std(forces) / 0.2 == pytest.approx(computed_sd, rel=0.25)


def test_uncertainty_includes_the_unexplained_misfit(fitted, tmp_path, capsys):
    (tmp_path / "model.json").write_text((fitted / "fit.json").read_text())
    words = [str(tmp_path / "model.json"), "--force", "300 N", "--length", "180 mm"]

    def run_inverse():
        assert main(["inverse", *words, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    alone = run_inverse()
    left = {"improvement": {"held_out": {"force": {"rmse_equations": 5.0}}}, "noise": {"force": {"sd": 3.0}}}
    (tmp_path / "diagnosis.json").write_text(json.dumps(left))
    both = run_inverse()
    assert (alone["unexplained_force"], both["unexplained_force"]) == (0.0, 4.0)
    assert both["sd"] == pytest.approx(np.hypot(alone["sd"], 4.0 * both["slope_by_force"]))
    assert main(["inverse", *words]) == 0
    assert "for a force error of 4 N beyond noise on held-out blocks" in capsys.readouterr().out


def test_stated_muscle_is_announced_with_the_remedy(bench, fitted, capsys):
    words = ["--force", "300 N", "--length", "180 mm"]
    assert main(["inverse", str(bench / "made"), *words]) == 0
    printed = capsys.readouterr()
    assert printed.err == (
        f"pamjax: note: the values of {bench / 'made'} are as stated, not fitted."
        " For fitted values, name the fit.json of `pamjax fit` instead.\n"
    )
    assert "no standard deviation is known: there is no fit, or a fitted parameter has none" in printed.out
    assert main(["inverse", str(fitted / "fit.json"), *words]) == 0
    assert "not fitted" not in capsys.readouterr().err


def test_command_without_a_standard_deviation_mentions_no_part_of_it(fitted, tmp_path, capsys):
    document = json.loads((fitted / "fit.json").read_text())
    document["parameters"]["thread.modulus"]["sd"] = None
    ((_, case_document),) = document["cases"].items()
    case_document["held_out"]["rmse"]["force"]["value"] = 50.0
    (tmp_path / "fit.json").write_text(json.dumps(document))
    words = ["inverse", str(tmp_path / "fit.json"), "--force", "300 N", "--length", "180 mm"]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "±" not in printed
    assert "no standard deviation is known: there is no fit" in printed
    document["parameters"]["thread.modulus"]["at_limit"] = True
    case_document["rmse"]["force"]["value"] = 20 * case_document["noise"]["force"]["sd"]
    case_document["noise"]["force"]["excess"] = 16.0
    (tmp_path / "fit.json").write_text(json.dumps(document))
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "no standard deviation is known, because thread.modulus is at its limit and has none" in printed
    assert (
        "check the fit first: its rmse of force is 20 times the noise and thread.modulus is at its limit;"
        " run `pamjax diagnose`"
    ) in " ".join(printed.split())
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["uncertainty"] == "unknown"


def test_infeasible_command_is_reported_with_its_limit(fitted, capsys):
    assert main(["inverse", str(fitted / "fit.json"), "--force", "9 kN", "--pressure", "400 kPa"]) == 0
    printed = capsys.readouterr().out
    loaded = load_muscle(fitted / "fit.json")
    long = loaded.calibrated_range["length"][1]
    most = float(loaded.muscle(400e3, long).force)
    assert (
        f"the force is above the maximum of {format_quantity(most, 'N')}, at the longest length,"
        f" {format_quantity(long, 'mm')}" in printed
    )
    short = loaded.calibrated_range["length"][0]
    assert main(["inverse", str(fitted / "fit.json"), "--force", "300 N", "--length", "100 mm"]) == 0
    printed = capsys.readouterr().out
    assert (
        f"the length 100 mm is outside {format_quantity(short, 'mm')} to {format_quantity(long, 'mm')}"
        in printed
    )
    assert f", at {format_quantity(short, 'mm')}" in printed
    assert main(["inverse", str(fitted / "fit.json"), "--force", "-50 N", "--length", "180 mm"]) == 0
    assert "the force is below the minimum of 0 N, at the lowest pressure, 0 kPa" in capsys.readouterr().out
    words = ["--force", "9 kN", "--length", "180 mm", "--json"]
    assert main(["inverse", str(fitted / "fit.json"), *words]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["limit"] == "TOO_STRONG"
    assert "at the highest pressure" in document["says"]
    assert document["reached_force"] == pytest.approx(float(loaded.muscle(document["value"], 0.18).force))


def test_export_reports_its_interpolation_error(fitted, tmp_path, capsys):
    assert main(["inverse", str(fitted / "fit.json"), "--export", str(tmp_path)]) == 0
    assert "interpolation error below pressure" in capsys.readouterr().out
    robot = Controller(tmp_path / "controller.npz")
    pressure, status = robot.pressure(300.0, 0.18)
    assert status == 0
    force = load_muscle(fitted / "fit.json").muscle(float(pressure), 0.18).force
    assert float(force) == pytest.approx(300.0, rel=1e-3)


def test_muscle_calibrated_at_one_length_accepts_other_lengths(fitted, tmp_path, capsys):
    document = json.loads((fitted / "fit.json").read_text())
    ((_, case),) = document["cases"].items()
    case["calibrated"]["length"] = {"low": 0.2, "high": 0.2}
    (tmp_path / "fit.json").write_text(json.dumps(document))
    assert (
        main(["inverse", str(tmp_path / "fit.json"), "--force", "300 N", "--length", "180 mm", "--json"]) == 0
    )
    result = json.loads(capsys.readouterr().out)
    assert result["limit"] == "OK"
    (beyond,) = (case for case in result["beyond"] if "length" in case)
    assert beyond == (
        "extrapolation: length 180 mm, calibrated at 200 mm; the ± excludes the error of extrapolation"
    )


@pytest.mark.parametrize("words", [[], ["--force", "3 N"], ["--force", "3 N", "--export", "x"]])
def test_incomplete_target_is_refused(fitted, capsys, words):
    assert main(["inverse", str(fitted / "fit.json"), *words]) == 2
    assert "`--force` with `--length` or with `--pressure`" in capsys.readouterr().err


@pytest.fixture(scope="module")
def write_posterior(fitted, tmp_path_factory):
    """Write a posterior.nc with the normal distribution of the fit, scaled by a factor."""
    document = json.loads((fitted / "fit.json").read_text())
    names = document["correlation"]["names"]
    ((case, case_document),) = document["cases"].items()
    value = np.array([case_document["muscle"]["numbers"][n] for n in names])
    parameters = [document["parameters"][n] for n in names]
    sd = np.array([t["sd"] * compute_si_factor(t["unit"]) for t in parameters])
    raw = np.random.default_rng(5).standard_normal((DRAW_COUNT, sd.size))
    # Mean zero and unit covariance exactly: the remaining difference is not random.
    raw -= raw.mean(axis=0)
    unit = raw @ np.linalg.inv(np.linalg.cholesky(np.cov(raw.T))).T
    steps = unit @ np.linalg.cholesky(np.array(document["correlation"]["matrix"]) + 1e-9 * np.eye(sd.size)).T
    about = {
        "law": case_document["muscle"]["law"],
        "mechanisms": "[]",
        "checksum": json.dumps({case: case_document["checksum"]}),
    }

    def write_draws(wide, **other):
        values = value + wide * steps * sd
        data = {n: (("chain", "draw"), values[None, :, k]) for k, n in enumerate(names)}
        tree = xr.DataTree.from_dict({"posterior": xr.Dataset(data)})
        tree.attrs = about | other
        file = tmp_path_factory.mktemp("drawn") / "posterior.nc"
        tree.to_netcdf(file, engine="h5netcdf")
        return file

    return write_draws


@pytest.mark.parametrize("words", [["--length", "180 mm"], ["--pressure", "300 kPa"]])
def test_normal_posterior_agrees_with_the_covariance(fitted, write_posterior, capsys, words):
    force = float(load_muscle(fitted / "fit.json").muscle(300e3, 0.18).force)
    words = ["inverse", str(fitted / "fit.json"), "--force", f"{force:.3f} N", *words, "--json"]

    def run_inverse(*more):
        assert main([*words, *more]) == 0
        return json.loads(capsys.readouterr().out)

    straight = run_inverse()
    near, far = (run_inverse("--posterior", str(write_posterior(wide))) for wide in (0.2, 0.4))
    # All include the same force error on held-out blocks. The remaining difference is curvature.
    own, near_own, far_own = (
        math.sqrt(result["sd"] ** 2 - (result["slope_by_force"] * result["unexplained_force"]) ** 2)
        for result in (straight, near, far)
    )
    assert near_own / 0.2 == pytest.approx(own, rel=5e-3)
    assert far_own / near_own == pytest.approx(2.0, rel=5e-3)
    assert near["value"] == pytest.approx(straight["value"], rel=1e-4)
    assert near["draws"]["feasible_share"] == 1.0
    width = near["draws"]["high"] - near["draws"]["low"]
    assert width == pytest.approx(2 * 1.645 * near_own, rel=0.15)


def test_draws_give_the_probability_of_a_feasible_command(fitted, write_posterior, capsys):
    muscle = load_muscle(fitted / "fit.json").muscle
    top = load_muscle(fitted / "fit.json").calibrated_range["pressure"][1]
    most = float(muscle(top, 0.18).force)
    words = ["inverse", str(fitted / "fit.json"), "--force", f"{most:.9g} N", "--length", "180 mm"]
    assert main([*words, "--posterior", str(write_posterior(1.0)), "--json"]) == 0
    # The largest force of the median draw is infeasible for half of the draws.
    assert json.loads(capsys.readouterr().out)["draws"]["feasible_share"] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"law": "toe"}, "must have the model of the muscle (elastic); got toe"),
        ({"mechanisms": '["braid_friction"]'}, "got elastic + braid_friction"),
        ({"checksum": '{"other": "0"}'}, "must come from the recording of the muscle; got other"),
    ],
)
def test_posterior_of_another_muscle_is_refused(fitted, write_posterior, capsys, other, message):
    words = ["inverse", str(fitted / "fit.json"), "--force", "300 N", "--length", "180 mm"]
    assert main([*words, "--posterior", str(write_posterior(1.0, **other))]) == 2
    assert message in capsys.readouterr().err


def add_friction(fitted, folder):
    """Return the fitted muscle with friction, as a diagnosis writes it."""
    document = json.loads((fitted / "fit.json").read_text())
    ((_, case_document),) = document["cases"].items()
    case_document["muscle"]["mechanisms"] = ["braid_friction", "force_offset"]
    case_document["muscle"]["numbers"] |= {"braid_friction.coefficient": 0.3, "force_offset.offset": 1.0}
    (folder / "model.json").write_text(json.dumps(document))
    return folder / "model.json"


@pytest.mark.slow
def test_neglected_effects_are_reported_with_the_uncertainty(fitted, tmp_path, capsys):
    words = ["inverse", str(add_friction(fitted, tmp_path)), "--force", "300 N", "--length", "180 mm"]
    assert main([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["left_out"] == ["braid_friction", "force_offset"]
    assert document["friction_force"] > 0
    assert document["friction_command"] == pytest.approx(
        document["friction_force"] * document["slope_by_force"]
    )
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert f", and up to ± {format_quantity(document['friction_command'], 'kPa', 2)} by friction" in printed
    assert (
        f"adds up to {format_quantity(document['friction_force'], 'N', 2)} to the force after lengthening"
        in printed
    )
    assert "the command assumes exact sensors and a rigid rig and neglects force_offset" in printed
    assert "the command assumes a muscle at rest and neglects braid_friction" in printed


def test_command_reports_the_slopes_of_the_stiffness(fitted, capsys):
    words = ["inverse", str(fitted / "fit.json"), "--force", "300 N", "--length", "180 mm"]
    assert main([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert f"{document['stiffness_by_pressure']:+.4g} N/mm per kPa" in printed
    assert "neglected" not in printed
