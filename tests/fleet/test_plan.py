"""Plans of a fleet: cases by folder and pattern, origins, names of tasks, and refused entries."""

import datetime

import pytest

from pamjax.cli.main import main
from pamjax.errors import BadInput
from pamjax.fleet.plan import read_plan
from pamjax.fleet.store import FleetStore, TaskOutcome, open_stage_folder, read_outcome, write_outcome
from pamjax.fleet.task import build_task, describe_task


@pytest.fixture
def bench(tmp_path):
    """Return a folder with the cases north/a, north/b and south/a."""
    assert main(["new", str(tmp_path / "north" / "a")]) == 2  # its parent must exist
    for name in ("north/a", "north/b", "south/a"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        assert main(["new", str(tmp_path / name)]) == 0
    return tmp_path


def write_fleet(folder, text):
    (folder / "FLEET.toml").write_text(text)
    return folder / "FLEET.toml"


def test_folder_patterns_and_files_give_the_same_cases(bench):
    names = ["north/a", "north/b", "south/a"]
    assert [case.name for case in read_plan([bench]).cases] == names
    assert [case.name for case in read_plan([write_fleet(bench, "")]).cases] == names
    assert [case.name for case in read_plan([bench / "north" / "*"]).cases] == ["a", "b"]
    two = read_plan([bench / "north" / "a", bench / "south" / "a"])
    assert [case.name for case in two.cases] == ["north/a", "south/a"]
    assert read_plan([bench / "south" / "a"]).cases[0].name == "a"


def test_groups_and_muscle_toml_state_the_origin(bench):
    muscle = bench / "north" / "a" / "muscle.toml"
    muscle.write_text(muscle.read_text() + '\n[specimen]\nserial = 12\ntype = "short"\nbench = "old"\n')
    text = """
stages = ["fit"]
[[groups]]
cases = "north/*"
bench = "north"
date = 2026-03-02
[[groups]]
cases = ["north/b"]
date = "2026-03-09"
"""
    plan = read_plan([write_fleet(bench, text)])
    first, second, third = (case.specimen for case in plan.cases)
    assert (first.bench, first.serial, first.type) == ("north", "12", "short")
    assert first.date == datetime.date(2026, 3, 2)
    assert (second.date, second.type) == (datetime.date(2026, 3, 9), "example muscle")
    assert third.bench is None
    assert plan.stages == ("fit",)


@pytest.mark.parametrize(
    "line", [f"x = {'[' * 5000}", f"x = {'9' * 5000}", "x = '\xff"], ids=["nested", "long number", "no UTF-8"]
)
def test_unreadable_muscle_toml_leaves_the_other_cases(bench, line):
    """The task of the case reports such a file."""
    (bench / "north" / "a" / "muscle.toml").write_bytes(line.encode("latin-1"))
    first, second, _ = read_plan([bench]).cases
    assert (first.specimen.type, second.specimen.type) == (None, "example muscle")


def test_task_is_named_by_inputs_and_settings(bench):
    def name_task(stage="fit", **changes):
        plan = read_plan([bench], **changes)
        return build_task(plan, plan.cases[0], stage, bench).key

    before = name_task()
    assert before == name_task(stages=["fit"])
    assert before != name_task(seed=1)
    assert before != name_task(report=False)
    assert before != name_task("check")
    assert name_task("check") == name_task("check", seed=1)
    file = bench / "north" / "a" / "recording.csv"
    file.write_text(file.read_text() + "1.5,200,175,500,,1\n")
    assert before != name_task()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stage = 1", "unknown entry `stage` (FLEET.toml). Did you mean `stages`?"),
        (
            'stages = ["fti"]',
            '`stages` must be "check", "fit", "diagnose", "validate" or "sample"; got \'fti\' in FLEET.toml.',
        ),
        ("stages = []", "`stages` must not be empty"),
        ("seed = -1", "`seed` must be at least 0; got -1 in FLEET.toml."),
        ("cases = 3", "`cases` must be a list in brackets; got 3 in FLEET.toml."),
        ('cases = "../x"', "a pattern of `cases` must lead into the folder; got '../x' in FLEET.toml."),
        ('cases = "/etc/*"', "a pattern of `cases` must lead into the folder; got '/etc/*' in FLEET.toml."),
        ('cases = "**x"', "'**x'"),
        ('cases = "west/*"', "no folder with recording.csv matches 'west/*' (FLEET.toml)."),
        ('folder = "west"', "`folder` must be a folder; got"),
        ('[[groups]]\nbench = "n"', "`cases` must be stated ([groups] of FLEET.toml)."),
        ('[[groups]]\ncases = "*/a"\nbench = 1.5', "`bench` must be a text in quotes or a whole number"),
        ('[[groups]]\ncases = "*/a"\ndate = "soon"', "`date` must be a day such as 2026-03-02; got 'soon'"),
        ('stages = ["validate"]', "the stage validate needs a model.json or fit.json (FLEET.toml)."),
        ('stages = ["validate"]\n[validate]\nmodel = "no.json"', "no.json"),
        ('[validate]\ncase = "a"', "`model` must be stated ([validate] of FLEET.toml)."),
        ('stages = ["validate"]\n[validate]\nmodel = "a"', "must be the path of a model.json or fit.json"),
        ('stages = ["validate"]\n[validate]\nmodel = "a\\u0000.json"', "must be the path of a model.json"),
        ("[sample]\ness = inf", "`ess` must be a finite number; got inf in [sample] of FLEET.toml."),
        ("[sample]\nmax_draws = 99", "`max_draws` must be at least 100; got 99 in [sample]"),
        ("[sample]\nrhat = 1", "`rhat` must be more than 1; got 1 in [sample] of FLEET.toml."),
        ("[validat]", "Did you mean `validate`?"),
        ("[fit]\nfolds = 1", "`folds` must be at least 2; got 1 in [fit] of FLEET.toml."),
        ("[fit", "FLEET.toml must be TOML"),
    ],
)
def test_refused_files(bench, text, message):
    with pytest.raises(BadInput) as error:
        read_plan([write_fleet(bench, text)])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_model_of_the_stage_validate_is_part_of_its_name(bench):
    (bench / "model.json").write_text("{}")
    text = 'stages = ["check", "validate"]\n[validate]\nmodel = "model.json"'
    store = FleetStore(bench / "out")

    def list_tasks():
        plan = read_plan([write_fleet(bench, text)])
        return store.list_tasks(plan, plan.cases[0])

    check, validate = list_tasks()
    assert (check.model, validate.model) == (None, bench / "out" / "model.json")
    assert "model" not in describe_task(validate)
    (bench / "model.json").write_text("{ }")
    assert list_tasks()[0].key == check.key
    assert list_tasks()[1].key != validate.key


def test_store_has_a_copy_of_the_model(bench):
    (bench / "model.json").write_text("{}")
    plan = read_plan([bench], stages=["validate"], model=bench / "model.json")
    store = FleetStore(bench / "out")
    store.prepare()
    store.write_plan(plan)
    (task, *_) = store.list_tasks(plan, plan.cases[0])
    assert task.model is not None
    assert task.model.read_text() == "{}"


def test_model_of_the_command_line_replaces_that_of_the_file(bench):
    for name in ("model.json", "other.json"):
        (bench / name).write_text("{}")
    file = write_fleet(bench, '[validate]\nmodel = "model.json"\ncase = "a"')
    plan = read_plan([file], stages=["validate"], model=bench / "other.json")
    assert plan.model is not None
    assert (plan.model.file, plan.model.case) == (bench / "other.json", "a")
    with pytest.raises(BadInput, match="`--model` needs the stage validate"):
        read_plan([file], stages=["check"], model=bench / "other.json")


def test_sampler_is_part_of_the_name_of_a_posterior(bench):
    def name_tasks(sampler):
        plan = read_plan([write_fleet(bench, f'stages = ["fit", "sample"]\n[sample]\nsampler = "{sampler}"')])
        tasks = FleetStore(bench / "out").list_tasks(plan, plan.cases[0])
        return [(task.key, describe_task(task)["versions"]) for task in tasks]

    (fit, fit_versions), (sample, versions) = name_tasks("emcee")
    assert "emcee" in versions
    assert "emcee" not in fit_versions
    assert name_tasks("nuts")[0][0] == fit
    assert name_tasks("nuts")[1][0] != sample


def test_nested_cases_and_missing_paths_are_refused(bench):
    assert main(["new", str(bench / "north" / "a" / "inner")]) == 0
    with pytest.raises(BadInput, match="case folders must be apart"):
        read_plan([bench])
    with pytest.raises(BadInput, match=r"a fleet must be a FLEET\.toml, a folder of cases, or case folders"):
        read_plan([bench / "nowhere"])


def test_foreign_folder_is_no_store(bench):
    (bench / "out").mkdir()
    (bench / "out" / "notes.txt").write_text("mine")
    with pytest.raises(BadInput, match=r"the store of a fleet must be a folder with fleet\.json"):
        FleetStore(bench / "out").prepare()


def test_locked_folder_without_a_plan_is_prepared(bench):
    """A run that has just started has its lock and no plan yet."""
    (bench / "out").mkdir()
    (bench / "out" / ".lock").touch()
    FleetStore(bench / "out").prepare()
    assert [path.name for path in (bench / "out").iterdir()] == [".lock"]


def test_stage_folder_appears_complete_or_not_at_all(bench):
    plan, store = read_plan([bench]), FleetStore(bench / "out")
    (task, *_) = store.list_tasks(plan, plan.cases[0])

    def write(text, fails=False):
        with open_stage_folder(task) as folder:
            (folder / "note.txt").write_text(text)
            write_outcome(folder, task, TaskOutcome(task.key, "done"))
            if fails:
                raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write("first", fails=True)
    assert read_outcome(task.target, task.key).state == "open"
    write("second")
    with pytest.raises(OSError, match="disk full"):
        write("third", fails=True)
    assert (task.target / "note.txt").read_text() == "second"
    assert read_outcome(task.target, task.key).state == "done"
    assert read_outcome(task.target, "another key").state == "open"
    write("fourth")
    assert [path.name for path in task.target.parent.iterdir()] == [task.target.name]
    assert (task.target / "note.txt").read_text() == "fourth"
