"""The report: one file, whole, readable by people and machines, with whatever records there are."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from hil.errors import InputError
from hil.importing.importer import import_record
from hil.numbers import quantity
from hil.records.diagnosis import to_model
from hil.records.estimates import Estimates
from hil.records.result import TOO_SLOW, Parameter, Part, load_result, save_result
from hil.records.runfolder import RunFolder
from hil.records.truth import read_truth
from hil.report.figures import pattern
from hil.report.figures.angle import angle_figure
from hil.report.figures.spectrum import amplitude_density
from hil.report.material import Material
from hil.report.page import write_report
from hil.report.theme import drawing_style
from hil.scoring.score import score
from tests.records.synthetic_run import Options, write_run
from tests.records.test_diagnosis import answer

pytestmark = pytest.mark.slow  # whole pages

EVERYTHING = [
    "Angle",
    "Rate",
    "Parameters",
    "Pattern in the plane",
    "Signals",
    "Measured and predicted",
    "Innovation in time",
    "Innovation spectrum",
    "Turnaround",
]


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the drawing, which is nearly all of the time, where only words are looked at."""

    def empty(figure, key, title, alt):
        return f'<svg role="img" aria-label="{key}"></svg>'

    monkeypatch.setattr("hil.report.markup.inline_svg", empty)


def figures(page):
    """Titles of the figures in their order, checked to be numbered from 1."""
    found = re.findall(r"<b>Figure (\d+)\. ([^<]+)\.</b>", page)
    assert [int(number) for number, _ in found] == list(range(1, len(found) + 1))
    return [title for _, title in found]


class Structure(HTMLParser):
    """Fails on a tag that closes what was not opened; collects ids, references and outside addresses."""

    VOID = ("meta", "link", "br", "img", "hr")

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.references, self.outside, self.headers, self.cells = [], [], [], [], 0, 0

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        self._look(tag, dict(attrs))

    def handle_startendtag(self, tag, attrs):
        self._look(tag, dict(attrs))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def _look(self, tag, attrs):
        self.headers += tag == "th" and "scope" in attrs
        self.cells += tag in ("th", "td")
        assert tag not in ("script", "iframe", "object", "img", "link", "base")
        if "id" in attrs:
            self.ids.append(attrs["id"])
        for name in ("href", "xlink:href", "src"):
            if name in attrs:
                (self.references if attrs[name].startswith("#") else self.outside).append(attrs[name].lstrip("#"))
        for name in ("clip-path", "fill", "style"):
            self.references += re.findall(r"url\(#([^)]+)\)", attrs.get(name) or "")
        self.references += (attrs.get("aria-labelledby") or "").split()


def checked(page):
    structure = Structure()
    structure.feed(page)
    assert structure.open == []
    assert len(structure.ids) == len(set(structure.ids))
    assert set(structure.references) <= set(structure.ids)
    assert structure.outside == []
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)
    return structure


def written(folder, truth=None):
    return write_report(folder, truth).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The page of a scored run, every figure of it drawn."""
    folder = tmp_path_factory.mktemp("drawn") / "20250314-092653-bench"
    truth = write_run(folder, Options(line_V=3e-5))
    score(folder, truth)
    return written(folder, truth)


def test_a_scored_run_has_every_figure_and_table(page):
    assert figures(page) == EVERYTHING
    assert checked(page).headers > 40
    assert "<strong>Good.</strong> <span>Angle within" in page
    assert "minus truth" in page
    assert "of it, control imperfection" in page
    assert "At 3 f₀ the innovation stands above twice the noise floor" in page
    assert "deadline" in page
    assert "bare p99.9" in page
    assert "memory_s = 2.0" in page


def test_every_figure_can_be_read_aloud_and_parsed(page):
    for svg in re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL):
        root = ElementTree.fromstring(svg.replace("xlink:href", "href"))
        title, description = root[0], root[1]
        assert (title.tag, description.tag) == ("title", "desc")
        assert root.get("role") == "img"
        assert root.get("aria-labelledby") == f"{title.get('id')} {description.get('id')}"
        assert len(description.text) > 40
        assert not re.search(r"\bnan\b", description.text)


def test_figures_take_the_colours_of_the_page(make_run):
    folder, _ = make_run()  # beside its rivals, in place of a truth
    page = written(folder)
    colours = set(re.findall(r"#[0-9a-f]{6}", "".join(re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL))))
    assert colours <= {"#000000", "#ffffff"}
    used = set(re.findall(r"var\(--(\w+)\)", page))
    for scheme in (r":root \{(.*?)\}", r"dark\) \{\s*:root \{(.*?)\}", r"print \{\s*:root \{(.*?)\}"):
        defined = re.search(scheme, page, flags=re.DOTALL).group(1)
        assert used - {"text", "plain", "fixed"} <= set(re.findall(r"--(\w+):", defined))


@pytest.mark.long
def test_equal_records_give_equal_pages(make_run):
    folder, truth = make_run()
    assert written(folder, truth) == written(folder, truth)


def test_without_truth_the_angle_stands_beside_its_rivals(undrawn, make_run):
    folder, _ = make_run()
    page = written(folder)
    assert figures(page) == EVERYTHING
    assert "difference from φ" in page
    assert "truth" not in page.replace("truthful", "")
    assert "declared" in page


@pytest.mark.parametrize(
    ("missing", "expected"),
    [
        (["timing"], EVERYTHING[:-1]),
        (["innovation"], [name for name in EVERYTHING if "nnovation" not in name and "predicted" not in name]),
        (["capture"], [name for name in EVERYTHING if name not in ("Signals", "Measured and predicted")]),
        (["estimates"], [name for name in EVERYTHING[4:] if "predicted" not in name]),
        (["estimates", "innovation", "timing"], ["Signals"]),
    ],
)
def test_what_was_not_recorded_is_left_out(undrawn, make_run, missing, expected):
    folder, _ = make_run()
    for name in missing:
        (folder / f"{name}.arrow").unlink()
    page = written(folder)
    checked(page)
    assert figures(page) == expected


def test_a_killed_run_says_so(undrawn, make_run):
    folder, _ = make_run(interrupted=True, result=False)
    (folder / "bench.toml").unlink()
    page = written(folder)
    assert 'class="verdict bad"><strong>Interrupted.</strong>' in page
    assert "no end marker" in page
    assert "Bench file as run" not in page
    assert figures(page) == EVERYTHING


@pytest.mark.long
def test_one_axis(make_run):
    folder, _ = make_run(axes=1)
    page = written(folder)
    checked(page)
    assert figures(page) == [name for name in EVERYTHING if name not in ("Angle", "Rate", "Pattern in the plane")]
    assert "drive gain x" in page


def test_a_failed_run_gives_its_reasons(undrawn, make_run):
    folder, _ = make_run()
    result = load_result(folder / "result.json")
    reasons = ("innovation 3.1 × the noise floor", "5 % of answers late")
    save_result(folder / "result.json", result.model_copy(update={"verdict": "failed", "reasons": reasons}))
    page = written(folder)
    assert 'class="verdict bad"><strong>Failed.</strong>' in page
    assert "Innovation 3.1 × the noise floor; 5 % of answers late" in page


PARTS = {
    "safety": Part(outcome="good", reason="every stop was confirmed"),
    "machine": Part(outcome="failed", reason="12 % had no answer in time", next="hil doctor"),
    "model": Part(outcome="complete", reason="nothing is missing"),
    "angle": Part(outcome="good", reason="± 1.9 mrad"),
}


def judged(folder, verdict, **parts):
    """The run with a verdict in parts; its page."""
    result = load_result(folder / "result.json")
    parts = PARTS | parts
    against = [part for part in parts.values() if part.against]
    update = {"verdict": verdict, "parts": parts, "reasons": tuple(part.reason for part in against)}
    update["next"] = next((part.next for part in against if part.next), "xdg-open report.html")
    save_result(folder / "result.json", result.model_copy(update=update))
    page = written(folder)
    checked(page)
    return page.partition("<h2")[0]


def test_the_first_screen_names_every_part(undrawn, make_run):
    folder, _ = make_run()
    screen = judged(folder, "failed")
    assert 'class="verdict slow"><strong>Failed.</strong>' in screen  # the machine's trouble is not the model's
    assert "Machine failed; safety good, model complete, angle good." in screen
    rows = re.findall(r'<div class="(\w+)"><dt>(\w+)</dt><dd><b>(\w+)</b> ([^<]*)', screen)
    assert [(name, outcome, reason.strip()) for _, name, outcome, reason in rows] == [
        (name, part.outcome, part.reason) for name, part in PARTS.items()
    ]
    assert [tone for tone, *_ in rows] == ["good", "slow", "good", "good"]
    assert screen.count("<code>hil doctor</code>") == 1
    assert "alarm" not in screen.partition("</style>")[2]


def test_what_the_model_lacks_is_not_the_machines_trouble(undrawn, make_run):
    folder, _ = make_run()
    lacks = Part(outcome="lacks", reason="drive gain, + 2.0 %", next="hil trace runs/a")
    screen = judged(folder, "failed", model=lacks)
    assert 'class="verdict bad"' in screen
    assert "Machine failed, model lacks something; safety good, angle good." in screen
    assert "<code>hil trace runs/a</code>" in screen


def test_unsafe_stands_above_everything(undrawn, make_run):
    folder, _ = make_run()
    unsafe = Part(outcome="unsafe", reason="the board did not confirm SAFE: cut the supply", next="cut the supply")
    screen = judged(folder, "unsafe", safety=unsafe)
    body = screen.partition("<body>")[2]
    first = re.search(r"<p[^>]*>.*?</p>", body, flags=re.DOTALL)
    assert first is not None
    assert 'role="alert"' in first.group()
    assert "The board did not confirm SAFE: cut the supply" in first.group()
    assert 'class="verdict bad"><strong>Unsafe.</strong>' in screen


def test_the_count_on_the_page_adds_up(undrawn, make_run):
    folder, _ = make_run()
    page = written(folder)
    table = re.search(r"<caption>What became of each sample</caption>.*?</table>", page, flags=re.DOTALL)
    assert table is not None
    counts = [int(re.sub(r"\D", "", cell)) for cell in re.findall(r'<td class="n">([^<%]*)</td>', table.group())]
    *parts, whole = counts
    assert sum(parts) == whole == 8000
    assert parts[1] == 4  # answered late
    assert "7996" in page.partition("<h2")[0] or "99.95" in page.partition("<h2")[0]
    assert re.search(r"[\d.]+\u00a0% of these answers left the host after the deadline", page)


def test_a_rate_channel_is_a_reference(undrawn, make_run, tmp_path):
    folder, _ = make_run()
    (folder / "capture.arrow").unlink()
    t = np.arange(8000) / 4000
    rate = 1.57 + 0.6 * np.sin(np.pi * t)
    channels = np.stack([t, 0.1 * np.sin(t), 0 * t, rate], 1).tolist()
    lines = [",".join(map(repr, row)) for row in channels]
    (tmp_path / "ride.csv").write_text("t_s,vx_V,vy_V,rate_rad_s\n" + "\n".join(lines))
    import_record(tmp_path / "ride.csv", folder / "capture.arrow")
    page = written(folder)
    assert "difference from rate reference" in page
    error = float(re.search(r"reported angle φ ([\d.]+)\u00a0µrad rms", page).group(1))
    assert error == pytest.approx(2e-4 * 1e6, rel=0.5)


def test_words_from_outside_cannot_become_markup(undrawn, make_run):
    folder, _ = make_run()
    evil = '</script><img src="http://example.org/x.png" onerror=alert(1)> & "quotes"'
    result = load_result(folder / "result.json")
    part = Part(outcome="failed", reason=evil, next=evil)
    update = {"operator_note": evil, "verdict": "failed", "reasons": (evil,), "counters": {evil: 1}, "run": evil}
    update |= {"link": evil, "next": evil, "remarks": (evil,), "serial_number": evil, "versions": {evil: evil}}
    update |= {"parts": dict.fromkeys(("safety", "machine", "model", "angle"), part)}
    save_result(folder / "result.json", result.model_copy(update=update))
    (folder / "bench.toml").write_text(f"# {evil}\n[loop]\nsettle_s = 0.5\n")
    page = written(folder)
    checked(page)
    assert evil not in page
    assert "&lt;/script&gt;" in page


@pytest.mark.moderate
def test_the_pattern_of_a_resting_mass_is_a_point(make_run):
    folder, _ = make_run()
    material = Material(RunFolder.open(folder))
    resting = dict.fromkeys(("x_m", "vx_mps", "y_m", "vy_mps"), np.zeros(800))
    material.estimates = replace(material.estimates, columns={**material.estimates.columns, **resting})
    with drawing_style():
        assert pattern.pattern_figure(material) is not None


@pytest.mark.long
def test_a_run_that_diverged_still_has_a_page(make_run):
    folder, _ = make_run(result=False)
    estimates = Estimates.read(folder / "estimates.arrow")
    broken = {name: values.copy() for name, values in estimates.columns.items()}
    for values in broken.values():
        if values.dtype == float:
            values[values.size // 3 :] = np.nan
    from hil.records.estimates import estimates_layout
    from hil.records.stream import BlockWriter

    layout = estimates_layout(estimates.states, tick_rate_Hz=4000.0, every=10, angle=True)
    rows = np.zeros(len(estimates), layout.dtype)
    for name, values in broken.items():
        rows[name] = values
    with BlockWriter(folder / "estimates.arrow", layout) as writer:
        writer.push(rows)
    page = written(folder)
    checked(page)
    assert "Angle" in figures(page)


@pytest.mark.long
def test_a_record_of_a_few_samples_still_has_a_page(make_run):
    folder, truth = make_run(seconds=0.005, settle_s=1.0)
    page = written(folder, truth)
    checked(page)
    assert "20 samples" in page


def test_a_record_without_a_row_still_has_a_page(make_run):
    folder, truth = make_run(seconds=0.0, result=False)
    page = written(folder, truth)
    checked(page)
    assert figures(page) == []


@pytest.mark.long
def test_half_a_minute_at_4_kHz_stays_under_3_MB(make_run):
    folder, truth = make_run(seconds=30.0)
    assert write_report(folder, truth).stat().st_size < 3e6


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(InputError, match="no run folder"):
        write_report(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_white_noise_has_the_density_the_floor_is_drawn_at():
    noise = 3.0 * np.random.default_rng(5).standard_normal((200_000, 2))
    frequency, density = amplitude_density(noise, 4000.0)
    assert frequency[-1] == 2000.0
    np.testing.assert_allclose(np.sqrt(np.mean(density**2, axis=0)), 3.0 * np.sqrt(2 / 4000), rtol=0.02)


def test_importing_the_report_does_not_import_matplotlib():
    program = (
        "import sys, hil.report, hil.scoring.score\n"
        "print(sorted({'matplotlib', 'scipy'} & {name.split('.')[0] for name in sys.modules}))"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, check=True).stdout == b"[]\n"


@pytest.mark.long
def test_a_run_with_what_was_found_stands_beside_the_run_before(make_run, tmp_path):
    folder, truth = make_run()
    earlier = tmp_path / "runs" / "earlier"
    shutil.copytree(folder, earlier)
    for run in (folder, earlier):
        score(run, truth)
    found = to_model(answer(), record="ride", bench="S-test").model_dump(mode="json", by_alias=True)
    result = load_result(folder / "result.json")
    save_result(folder / "result.json", result.model_copy(update={"diagnosis": found}))
    page = write_report(folder, truth, earlier=(earlier, truth)).read_text(encoding="utf-8")
    assert figures(page)[0] == "Angle error before and after"
    assert "What the residual shows" in page
    assert "The model lacks: cubic stiffness of each axis" in page
    assert f"{result.angle_error_rms_rad * 1e3:.3g}" in page
    assert TOO_SLOW[1:] not in page
    slow = load_result(earlier / "result.json")
    parts = slow.parts | {"machine": Part(outcome="failed", reason="answered 91 % in time")}
    save_result(earlier / "result.json", slow.model_copy(update={"parts": parts}))
    assert TOO_SLOW[1:] in write_report(folder, truth, earlier=(earlier, truth)).read_text(encoding="utf-8")
    alone = write_report(folder, truth).read_text(encoding="utf-8")
    assert "The model lacks: cubic stiffness of each axis" in alone
    assert "Angle error before and after" not in alone


def first_screen(page: str) -> str:
    return page.partition("<section")[0]


def test_the_first_screen_says_when_what_and_how(make_run, undrawn):
    folder, truth = make_run()
    score(folder, truth)
    page = write_report(folder, truth).read_text(encoding="utf-8")
    top = re.sub(r"<[^>]+>", "", first_screen(page).partition("<main>")[2])
    for word in ("14 March 2025, 09:26", "board S-slow", "gyrohil 0.1.0", "2.000 s"):
        assert word in top, word
    headings = re.findall(r'<h2 id="([^"]+)">(.*?)</h2>', page)
    assert re.findall(r'<a href="#([^"]+)">(.*?)</a>', first_screen(page)) == headings
    assert headings[-1][0] == "bench"
    listing = page.rpartition('<h2 id="bench">')[2]
    assert listing.index("<details>") < listing.index("<pre")
    assert "<details open" not in listing


@pytest.mark.long
def test_degrees_stand_only_in_brackets_behind_radians(make_run):
    folder, truth = make_run(angle_drift=0.3)
    score(folder, truth)
    page = write_report(folder, truth).read_text(encoding="utf-8")
    words = re.sub(r"<style>.*?</style>|<[^>]+>", " ", page, flags=re.DOTALL)
    alone, beside = re.subn(r"rad(?:/s)?\s*\([^()]*°(?:\s?/s)?\)", "rad", words)
    assert beside
    assert re.findall(r".{0,40}(?:\b[µmk]?deg\b|°/s|\d\s?°|e\+\d).{0,20}", alone) == []


def test_a_run_after_a_trace_shows_the_figures_before_it_at_once(make_run, undrawn, tmp_path):
    folder, truth = make_run()
    before = tmp_path / "runs" / "20250314-092000-before"
    earlier_truth = write_run(before, Options(angle_drift=0.3))
    for run, true in ((folder, truth), (before, earlier_truth)):
        score(run, true)
    page = write_report(folder, truth, earlier=(before, earlier_truth)).read_text(encoding="utf-8")
    rms = load_result(before / "result.json").angle_error_rms_rad
    assert f"before: {quantity(rms, 'rad')}" in first_screen(page)


def test_the_page_does_not_say_how_to_open_itself(make_run, undrawn):
    folder, _ = make_run()
    place = folder / "result.json"
    save_result(place, load_result(place).model_copy(update={"next": f"xdg-open {folder}/report.html"}))
    assert "xdg-open" not in write_report(folder).read_text(encoding="utf-8")
    save_result(place, load_result(place).model_copy(update={"next": "hil doctor"}))
    assert "<code>hil doctor</code>" in first_screen(write_report(folder).read_text(encoding="utf-8"))


def test_a_coefficient_without_a_truth_says_so_in_its_row(make_run, undrawn):
    """As `c_both` of a form that was traced: no truth has it by this name."""
    folder, truth = make_run()
    result = score(folder, truth)
    form = Parameter(value=-2e13, ci95=(-2.1e13, -1.9e13), unit="1/(m²·s²)", truth=None)
    save_result(folder / "result.json", result.model_copy(update={"parameters": result.parameters | {"c_both": form}}))
    (row,) = re.findall(r"<tr><th[^>]*>c both</th>(.*?)</tr>", written(folder, truth))
    assert re.findall(r">([^<]*)</td>", row)[2:] == ["–", "–", "–"]


@pytest.mark.parametrize("given", [False, True], ids=["alone", "with truth"])
def test_the_angle_is_drawn_without_a_step_where_its_zero_is(tmp_path, given):
    truth = write_run(tmp_path / "run", Options(zeroed=True))
    drawing = angle_figure(Material(RunFolder(tmp_path / "run"), read_truth(truth) if given else None))
    lines = {line.get_label(): line for line in drawing.figure.axes[0].get_lines()}
    t, angle = lines["reported angle φ"].get_data()
    assert np.abs(np.diff(angle)).max() < 0.02  # 2.2 rad/s at most, a row each 2.5 ms
    assert angle[np.searchsorted(t, 0.5)] == pytest.approx(0.0, abs=0.01)
    if given:
        t, truth = lines["truth"].get_data()
        assert truth[0] == pytest.approx(angle[0], abs=0.01)
