"""Import of rig files: rows, units, order and clocks of the resulting case."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from pamjax.cli.main import main
from pamjax.errors import BadInput
from pamjax.records.case import read_case
from pamjax.records.importing.importer import import_case
from tests.records.importing.conftest import MUSCLE, PLAIN

ROOT = Path(__file__).parents[3]
HOSE = ROOT / "fits" / "portland_hose" / "hose-10mm-132.toml"
#: No licence is stated for the recordings, so they are not part of the project.
PUBLISHED = ROOT.parent / "shared" / "data" / "portland-hose" / "hose-10mm-132"

TESTS = [
    f"10mm_15cm_{kink}_Test{k}" for kink in ("Unkink", "kinked25", "kinked50", "kinked75") for k in (8, 9, 10)
]
LENGTHS = np.repeat([132.0, 126.75, 121.5, 116.25], 3)
LF = 4.4482216152605


def raw(seed, seconds=3.0):
    """Return a test in the layout of the hose bench, (n, 4): force, pressure, time in whole ms, valve."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(np.r_[0.0, rng.choice([0.001, 0.002], int(seconds / 0.0015))])
    pressure = 8.18 + 600 * np.sin(np.pi * time / seconds) ** 2 + 0.765 * rng.integers(-1, 2, time.size)
    force = 0.5 * pressure + 0.683 * rng.integers(-2, 3, time.size)
    return np.column_stack([force, pressure, time, 1 + (time > seconds / 2)]).round(4)


@pytest.fixture
def hose(tmp_path):
    """Return a copy of the hose folder whose files have other values."""
    shutil.copy(HOSE, tmp_path)
    (tmp_path / "muscle.toml").write_text(MUSCLE)
    for k, name in enumerate(TESTS):
        np.savetxt(tmp_path / f"{name}.csv", raw(k), delimiter=",", fmt="%.5g")
    # This file belongs to no test.
    np.savetxt(tmp_path / "10mm_15cm_Unkink_Offset.csv", raw(99), delimiter=",", fmt="%.5g")
    return tmp_path


def compute_expected(folder):
    """Return the expected case of the hose, block by block."""
    start_time, rows = 0.0, []
    for number, (name, length) in enumerate(zip(TESTS, LENGTHS, strict=True), 1):
        force, pressure, time, _ = np.loadtxt(folder / f"{name}.csv", delimiter=",").T
        test_rows = []
        for low in np.arange(0, time[-1] + 0.05, 0.05):
            in_block = (time >= low - 1e-9) & (time < low + 0.05 - 1e-9)
            if in_block.any():
                medians = [np.median(values[in_block]) for values in (time, pressure, force)]
                test_rows.append([start_time + medians[0], *medians[1:], length, number])
        rows += test_rows
        start_time = test_rows[-1][0] + 1.0
    return np.array(rows).T


def test_layout_of_the_hose_bench(hose):
    result = import_case(hose / HOSE.name, hose / "case")
    recording = result.case.recording
    time, pressure, force, length, cycle = compute_expected(hose)
    assert result.tests == tuple(f"{name}.csv" for name in TESTS)
    assert result.samples == sum(len(raw(k)) for k in range(12))
    for got, wanted, digits in (
        (recording.time, time, 1e-4),
        (recording.pressure, pressure * 1e3, 0.1),
        (recording.length, length * 1e-3, 1e-8),
        (recording.force, force, 1e-4),
    ):
        np.testing.assert_allclose(got, wanted, rtol=0, atol=0.51 * digits)
    np.testing.assert_array_equal(recording.cycle, cycle)
    # The rig was moved between tests: each test is a continuous part.
    assert recording.is_run_start.sum() == 12


@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="no hose recordings next to the project")
def test_published_hose_case_is_unchanged_by_import(hose):
    """Each row of the published case becomes one block of raw samples, and the import returns this row."""
    known = read_case(PUBLISHED).recording
    for number, name in enumerate(TESTS, 1):
        rows = np.flatnonzero(known.cycle == number)
        start_time = known.time[rows[0] - 1] + 1.0 if number > 1 else 0.0
        time = (known.time[rows] - start_time).round(3)
        block = np.floor(time / 0.05 + 1e-9)
        table = np.column_stack([known.force[rows], known.pressure[rows] / 1e3, time, np.ones(rows.size)])
        # Three samples per row: the median is the middle one, and the first sample of a test is at 0 s.
        before = 0.9 * (time - 0.05 * block)
        before[0] = time[0]
        after = 0.9 * (0.05 * (block + 1) - time)
        samples = [table + np.outer(shift, [0, 0, 1, 0]) for shift in (-before, 0 * time, after)]
        raw_rows = np.stack(samples, axis=1).reshape(-1, 4)
        np.savetxt(hose / f"{name}.csv", raw_rows, delimiter=",", fmt="%.6f")
    imported = import_case(hose / HOSE.name, hose / "case").case.recording
    assert imported.n == known.n
    np.testing.assert_allclose(imported.force, known.force, atol=1e-3)
    np.testing.assert_allclose(imported.pressure, known.pressure, atol=1.0)
    np.testing.assert_allclose(imported.time, known.time, atol=2e-3)
    np.testing.assert_array_equal(imported.length, known.length)
    np.testing.assert_array_equal(imported.cycle, known.cycle)


def test_headers_units_and_a_static_map(rig):
    got = rig("P,other,Load [lbf]\n10,x,5\n20,y,11\n", columns=PLAIN)
    np.testing.assert_allclose(got.force, [5 * LF, 11 * LF], atol=1e-4)
    np.testing.assert_allclose(got.pressure, [68947.57, 137895.15], atol=0.1)
    assert got.time is None
    np.testing.assert_array_equal(got.cycle, [1, 1])


@pytest.mark.parametrize("above", ["# bench 2\n# Peter, Monday; 9 o'clock\n", "#\n", ""])
def test_comments_above_the_header_are_skipped(rig, above):
    got = rig(f"{above}P,Load [lbf]\n10,5\n20,11\n", columns=PLAIN)
    np.testing.assert_allclose(got.force, [5 * LF, 11 * LF], atol=1e-4)
    with pytest.raises(BadInput, match=f"row {above.count('#') + 3} of run.csv"):
        rig(f"{above}P,Load [lbf]\n10,5\n20,much\n", columns=PLAIN)


def test_header_behind_a_comment_mark_is_a_header(rig):
    columns = PLAIN.replace('"P"', '"# P"')
    assert columns != PLAIN
    got = rig("# bench 2\n# P,Load [lbf]\n10,5\n20,11\n", columns=columns)
    np.testing.assert_allclose(got.force, [5 * LF, 11 * LF], atol=1e-4)


def test_volts_decimal_commas_and_lines_above(rig):
    text = "# bench 2\nPeter, Monday\nU_F;p\n0,50;1,0\n1,50;2,0\n"
    columns = (
        'force = {column = "U_F", unit = "N", zero = 0.25, scale = 40}\npressure = {column = 2, unit = "bar"}'
    )
    got = rig(text, columns=columns, files='separator = ";"\ndecimal = ","\nskip = 2')
    np.testing.assert_allclose(got.force, [10, 50])
    np.testing.assert_allclose(got.pressure, [1e5, 2e5])


def test_closed_quotation_marks_are_accepted(rig):
    text = 'tube: 3/8"\n"Peter\nP,other,Load [lbf]\n10,"x, y",5\n20,"a ""b""",11\n'
    got = rig(text, columns=PLAIN, files="skip = 2")
    np.testing.assert_allclose(got.force, [5 * LF, 11 * LF], atol=1e-4)


def test_sampling_rate_replaces_a_clock(rig):
    text = "P,Load [lbf]\n" + "\n".join(f"{10 * (k % 7) + 10},{5 * (k % 7) + 5}" for k in range(20))
    got = rig(text, columns=PLAIN, files='rate = "500 Hz"')
    np.testing.assert_allclose(got.time, np.arange(20) / 500, atol=1e-9)


def test_tare_is_subtracted(rig):
    text = "t,P,Load [lbf]\n" + "\n".join(f"{k},{3 + 20 * (k > 3)},{7 + 10 * (k > 3)}" for k in range(8))
    tare = '[tare]\nend = "3 s"\nforce = "0 N"\npressure = "0 psi"'
    columns = PLAIN + '\ntime = {column = "t", unit = "s"}'
    got = rig(text, columns=columns, more=tare)
    np.testing.assert_allclose(got.force, [10 * LF] * 4, atol=1e-4)
    np.testing.assert_allclose(got.pressure, [20 * 6894.757] * 4, atol=0.1)


@pytest.mark.parametrize("more", ['force = "0 N"', ""])
def test_tare_without_duration_removes_no_row(rig, more):
    text = "t,P,Load [lbf]\n" + "\n".join(f"{k},{1 + 20 * k},{2 + 10 * k}" for k in range(4))
    columns = PLAIN + '\ntime = {column = "t", unit = "s"}'
    got = rig(text, columns=columns, more=f'[tare]\nend = "0 s"\n{more}')
    np.testing.assert_allclose(got.force / LF, 10 * np.arange(4) + (0 if more else 2), atol=1e-4)


def test_displacement_is_converted_to_length(rig, tmp_path):
    """A displacement sensor increases during shortening, has its own zero, and has one blank cell."""
    displacement = np.linspace(0, 20, 9)
    rows = [
        f"{k},{40 + 2 * k},{50 if k < 3 else ''},{12.35 + x}" for k, x in enumerate([0, 0, 0, *displacement])
    ]
    columns = PLAIN + '\ntime = {column = "t", unit = "s"}'
    columns += '\nlength = {column = "way", unit = "mm", scale = -1}'
    text = "t,P,Load [lbf],way\n" + "\n".join([*rows, "12,66,200,32.35"])
    got = rig(text, columns=columns, length="", more='[tare]\nend = "2 s"\nlength = "130 mm"')
    np.testing.assert_allclose(got.length, 0.13 - 1e-3 * np.r_[displacement, 20], atol=1e-6)
    (tmp_path / "case" / "recording.csv").unlink()
    (tmp_path / "case" / "muscle.toml").unlink()
    report = str(import_case(tmp_path / "rig.toml", tmp_path / "case"))
    assert "from 1 file with 10 samples" in report
    assert "tare: length reading -12.35 mm to -12.35 mm, true value 130 mm" in report
    assert "9 rows without force" in report
    with pytest.raises(BadInput, match="with a `scale` of -1 and the rest length in"):
        rig(text, columns=columns.replace(", scale = -1", ""), length="")


def test_one_file_per_channel_with_separate_clocks(rig, tmp_path):
    fast, slow = np.arange(0, 2.0, 0.002), np.arange(0, 2.0, 0.1)
    np.savetxt(tmp_path / "a_p.csv", np.column_stack([slow, 100 + 10 * slow]), delimiter=",")
    force = "\n".join(f"{t:.3f},{20 * t:.4f}" for t in fast)
    columns = "\n".join(
        f'{n} = {{column = {c}, unit = "{u}"}}'
        for n, c, u in [("time", 1, "s"), ("force", 2, "N"), ("pressure", 2, "kPa")]
    )
    got = rig(
        force,
        name="a_f.csv",
        columns=columns,
        files="header = false",
        file='{force = "a_f.csv", pressure = "a_p.csv"}',
    )
    assert got.n == fast.size
    inside = fast <= slow[-1]
    np.testing.assert_allclose(got.pressure[inside], 1e3 * (100 + 10 * fast[inside]), atol=0.1)
    assert np.isnan(got.pressure[~inside]).all()


@pytest.mark.parametrize("matrix", ["", 'matrix = "bench.data"'])
def test_a_mat_file(rig, tmp_path, matrix):
    time, pressure, force = np.arange(9.0), np.linspace(1e2, 3e2, 9), np.linspace(50, 90, 9)
    inside = (
        {"data": np.column_stack([time, pressure, force])}
        if matrix
        else {"t": time, "p": pressure, "F": force}
    )
    savemat(tmp_path / "run.mat", {"bench": inside})
    where = (1, 2, 3) if matrix else ('"bench.t"', '"bench.p"', '"bench.F"')
    columns = "\n".join(
        f'{n} = {{column = {c}, unit = "{u}"}}'
        for n, c, u in zip(("time", "pressure", "force"), where, ("s", "kPa", "N"), strict=True)
    )
    got = rig(columns=columns, files=matrix, file='"run.mat"')
    np.testing.assert_allclose([got.time, got.pressure / 1e3, got.force], [time, pressure, force], atol=1e-4)


def test_a_mat_file_of_version_7_3(rig, tmp_path):
    import h5py

    with h5py.File(tmp_path / "run.mat", "w") as file:
        file["p"], file["F"] = np.array([[1e2, 2e2]]), np.array([[50.0, 90.0]])
    columns = 'pressure = {column = "p", unit = "kPa"}\nforce = {column = "F", unit = "N"}'
    got = rig(columns=columns, file='"run.mat"')
    np.testing.assert_allclose(got.force, [50, 90])


def test_decreasing_time_is_reported_with_its_row(hose):
    lines = (hose / f"{TESTS[4]}.csv").read_text().splitlines()
    lines[100], lines[101] = lines[101], lines[100]
    (hose / f"{TESTS[4]}.csv").write_text("\n".join(lines))
    with pytest.raises(BadInput, match=rf"row 102 of {TESTS[4]}.csv. A file must contain one test"):
        import_case(hose / HOSE.name, hose / "case")


def test_import_command(hose, capsys):
    assert main(["import", str(hose / HOSE.name), "--out", str(hose / "case")]) == 0
    output = capsys.readouterr().out
    assert "from 12 files with" in output
    assert f"next: pamjax check {hose / 'case'}" in output
    assert main(["import", str(hose / HOSE.name), "--out", str(hose / "case")]) == 2
    assert "needs an empty folder" in capsys.readouterr().err


def write_lengths(folder, columns, header, rows):
    """Write a muscle, a file with rows, and their import file; return the latter's path."""
    (folder / "muscle.toml").write_text(MUSCLE)
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=header, comments="")
    text = f'muscle = "muscle.toml"\ntests = [{{file = "log.csv"}}]\n[columns]\n{columns}\n'
    (folder / "import.toml").write_text(f'{text}pressure = "p [kPa]"\nforce = "F [N]"\n')
    return folder / "import.toml"


ROWS = np.array([[0.0, 100.0, 50.0], [10.0, 200.0, 60.0], [25.0, 300.0, 40.0]])


@pytest.mark.parametrize(
    ("column", "header", "length"),
    [
        ('contraction = "Contraction (%)"', "Contraction (%)", [132.0, 118.8, 99.0]),
        ('contraction = {column = "x", unit = "1", scale = 0.01}', "x", [132.0, 118.8, 99.0]),
        ('shortening = "s [mm]"', "s [mm]", [132.0, 122.0, 107.0]),
        ('shortening = {column = "s [mm]", zero = 10.0}', "s [mm]", [142.0, 132.0, 117.0]),
    ],
)
def test_length_follows_from_contraction_or_shortening(tmp_path, column, header, length):
    rig = write_lengths(tmp_path, column, f"{header},p [kPa],F [N]", ROWS)
    recording = import_case(rig, tmp_path / "case").case.recording
    assert 1e3 * recording.length == pytest.approx(length, rel=1e-6)
