"""Reports: complete, offline, with text for each figure, and without errors in a browser."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pamjax.cli.main import main
from tests.view.html_page import Page

PAPER = str(Path(__file__).parents[2] / "fits" / "chambers_wereley_2022")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
#: Script at the end of a copy of the page: writes the width of the page into its title.
MEASURE = "<script>document.title = `wide ${document.documentElement.scrollWidth}`</script></body>"


@pytest.fixture(scope="session")
def posterior_folder(tmp_path_factory):
    """Return the folder of `pamjax sample` for the five rows of the paper."""
    out = tmp_path_factory.mktemp("posterior")
    assert main(["sample", PAPER, "--out", str(out), "--ess", "60", "--rhat", "1.3", "--no-figures"]) == 0
    return out


@pytest.fixture(params=["fitted", "posterior_folder", "diagnosed", "planned"])
def report(request):
    return request.getfixturevalue(request.param) / "report.html"


@pytest.mark.slow
def test_report_is_offline_and_describes_each_figure(report):
    text = report.read_text("utf-8")
    page = Page(text)
    outside = r"""(?:src|href)\s*=\s*["'](?!#|data:)|url\((?!#)|@import|https?://(?!www\.w3)"""
    assert not re.search(outside, text)
    assert page.every("script") == []
    pictures = page.every("svg")
    assert len(pictures) >= 4
    assert all(p["role"] == "img" and len(p["aria-label"]) > 10 for p in pictures)
    names = [attrs["id"] for _, attrs in page.elements if "id" in attrs]
    assert len(names) == len(set(names))
    assert [tag for tag, _ in page.elements].count("h1") == 1
    assert not re.search(r"\bnan\b|\bNone\b|\binf\b", page.text)
    assert re.search(r"pamjax (fit|sample|diagnose|plan) ", page.text)


def open_in_browser(report, script, width, folder):
    """Return the title that a script sets at the end of a page, and the errors of the browser."""
    copy = folder / "report.html"
    copy.write_text(report.read_text("utf-8").replace("</body>", script), "utf-8")
    words = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    words += [f"--window-size={width},900", f"--user-data-dir={folder / 'profile'}", copy.as_uri()]
    process = subprocess.run([BROWSER, *words], capture_output=True, text=True, timeout=120, check=False)
    assert process.returncode == 0, process.stderr
    title = re.search(r"<title>(.*?)</title>", process.stdout)
    assert title, "the page's end was not reached"
    return title[1], [line for line in process.stderr.splitlines() if "CONSOLE" in line]


#: Name that a page must show as text; as an element it would change the id of the body.
HOSTILE = """<img src=x onerror=document.body.id=1><script>document.body.id=1</script><"$x^{"""
#: Script that counts the elements that can run code, and tells whether one of them ran.
COUNT = """<script>
const active = document.querySelectorAll("script, img, iframe, [onerror], [onclick], [onload]").length;
document.title = `active ${active - 1} ${document.body.id || "unchanged"}`;
</script></body>"""


@pytest.fixture(scope="session")
def hostile_report(bench, tmp_path_factory):
    """Return the report of a fit whose folder, muscle and unused column have the hostile name."""
    folder = tmp_path_factory.mktemp("hostile")
    case = folder / HOSTILE.replace("/", "")
    shutil.copytree(bench / "made", case)
    muscle, table = case / "muscle.toml", case / "recording.csv"
    muscle.write_text(re.sub(r"(?m)^name = .*", f"name = '{HOSTILE}'", muscle.read_text()))
    assert HOSTILE in muscle.read_text()
    head, rows = table.read_text().split("\n", 1)
    rows = "".join(f"{line},1\n" for line in rows.splitlines())
    table.write_text(f'{head},"{HOSTILE.replace(chr(34), chr(34) * 2)} [N]"\n{rows}')
    words = ["fit", str(case), "--out", str(folder / "out"), "--no-figures"]
    assert main([*words, "--starts", "2", "--folds", "2"]) == 0
    return folder / "out" / "report.html"


@pytest.mark.slow
def test_report_of_a_fit_shows_names_as_text(hostile_report, fitted):
    page = Page(hostile_report.read_text("utf-8"))
    plain = Page((fitted / "report.html").read_text("utf-8"))
    assert page.list_active_parts() == plain.list_active_parts()
    assert HOSTILE in page.text


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium")
def test_names_run_no_script_in_a_browser(hostile_report, tmp_path):
    title, _ = open_in_browser(hostile_report, COUNT, 1200, tmp_path)
    assert title == "active 0 unchanged"
    # Negative control: the same name without escaping.
    (tmp_path / "unsafe.html").write_text(f"<html><body><title>x</title>{HOSTILE}</body></html>")
    title, _ = open_in_browser(tmp_path / "unsafe.html", COUNT, 1200, tmp_path)
    assert title == "active 2 1"


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium")
@pytest.mark.parametrize("width", [500, 1200])
def test_report_opens_in_a_browser(report, width, tmp_path):
    title, complaints = open_in_browser(report, MEASURE, width, tmp_path)
    assert complaints == []
    # No element is wider than the page: no horizontal scrolling.
    assert int(title.removeprefix("wide ")) <= width


#: Script of a page with a report in a frame, because a window of Chromium is at least 500 pixels wide.
MEASURE_FRAME = """<script>onload = () => {
const page = document.querySelector("iframe").contentDocument;
const lines = [...page.querySelectorAll(".whole")].map((e) => e.getClientRects().length);
document.title = `wide ${page.documentElement.scrollWidth} ${Math.max(1, ...lines)}`;
}</script></body>"""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium")
def test_report_fits_a_phone(report, tmp_path):
    page = html.escape(report.read_text("utf-8"))
    frame = tmp_path / "frame.html"
    frame.write_text(
        f'<html><body><iframe srcdoc="{page}" style="width: 390px; border: 0"></iframe></body></html>',
        "utf-8",
    )
    title, _ = open_in_browser(frame, MEASURE_FRAME, 600, tmp_path)
    width, lines_of_an_option = map(int, title.removeprefix("wide ").split())
    assert width <= 390
    assert lines_of_an_option == 1


@pytest.mark.slow
def test_report_of_a_fit_agrees_with_its_json(fitted):
    page = Page((fitted / "report.html").read_text("utf-8"))
    document = json.loads((fitted / "fit.json").read_text())
    table = page.table(["parameter", "value"])
    for name, number in document["parameters"].items():
        value, sd = (float(text) for text in re.findall(r"[\d.]+", table[name][0])[:2])
        assert value == pytest.approx(number["value"], rel=1e-3)
        assert sd == pytest.approx(number["sd"], rel=0.06)
    (case,) = document["cases"].values()
    scores = page.table(["channel", "fit"])
    assert float(scores["force"][0].split()[0]) == pytest.approx(case["rmse"]["force"]["value"], rel=1e-2)
    assert f"{case['rmse']['force']['value']:.3g} N" in page.text


@pytest.mark.slow
def test_report_of_a_posterior_agrees_with_its_json(posterior_folder):
    page = Page((posterior_folder / "report.html").read_text("utf-8"))
    document = json.loads((posterior_folder / "posterior.json").read_text())
    table = page.table(["parameter", "value"])
    assert set(document["parameters"]) <= set(table)
    for name, number in document["parameters"].items():
        if "verdict" in number:
            assert number["verdict"] in table[name][-1]


#: Script that selects the second isobar, and returns the opacity of the first and the second.
CHOOSE = """<script>
document.querySelector("#group-1").click();
const seen = (k) => getComputedStyle(document.querySelector(`.wide svg .group-${k}`)).opacity;
document.title = `seen ${seen(0)} ${seen(1)}`;
</script></body>"""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium")
def test_isobar_can_be_selected(fitted, tmp_path):
    title, _ = open_in_browser(fitted / "report.html", CHOOSE, 1200, tmp_path)
    first, second = map(float, re.fullmatch(r"seen ([\d.]+) ([\d.]+)", title).groups())
    assert first < 0.1
    assert second == 1
