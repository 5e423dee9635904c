"""The catalogue in the page: runs that the command line has left, found, marked, compared, deleted and taken back."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.browser.axe import violations
from tests.browser.bench_page import BenchPage, leave_run
from tests.service.serving import Serving, serving

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A service with two runs of one device, which somebody made before it began."""
    folder = tmp_path_factory.mktemp("bench") / "runs"
    for seed, name in enumerate(("first", "second")):
        leave_run(folder, name, seed)
    with serving(folder) as running:
        yield running


@pytest.fixture
def runs(page: BenchPage) -> BenchPage:
    """The page with the list of runs."""
    page.page.get_by_role("link", name="Runs").click()
    expect(page.page.locator("#runs-table tbody tr")).to_have_count(2)
    return page


def names(page: BenchPage) -> list[str]:
    """Of the runs that are listed, from the top."""
    listed: list[str] = page.page.locator("#runs-table tbody th").all_inner_texts()
    return listed


def test_runs_are_filtered_and_sorted(runs: BenchPage) -> None:
    page = runs.page
    page.get_by_role("button", name="name", exact=True).click()
    expect(page.locator("#runs-table th[aria-sort=descending]")).to_have_text("name")
    expect(page.locator("#runs-table tbody th").first).to_have_text("second")
    page.get_by_role("button", name="name", exact=True).click()
    expect(page.locator("#runs-table tbody th").first).to_have_text("first")
    assert names(runs) == ["first", "second"]
    page.get_by_label("Search").fill("second")
    expect(page.locator("#runs-table tbody tr")).to_have_count(1)
    expect(page.locator("#runs-total")).to_have_text("1 found")
    page.get_by_label("Search").fill("")
    page.get_by_label("Verdict").select_option("unsafe")
    expect(page.locator("#runs-none")).to_have_text("No run fits this filter.")


def test_tags_and_a_note_are_kept_in_the_folder(runs: BenchPage) -> None:
    page = runs.page
    page.get_by_role("link", name="first").click()
    page.get_by_label("New tag").fill("cold start")
    page.get_by_role("button", name="Add", exact=True).click()
    expect(page.get_by_role("button", name="Remove tag cold start")).to_be_visible()
    page.get_by_label("Note").fill("<b>after an hour in the chamber</b>")
    page.get_by_label("Note").blur()
    expect(page.locator("#notices")).to_contain_text("Note kept")
    folder = next(runs.service.folder.glob("*-first"))
    marks = json.loads((folder / "marks.json").read_text())
    assert marks["tags"] == ["cold start"]
    assert marks["note"] == "<b>after an hour in the chamber</b>"
    page.get_by_label("Tag", exact=True).fill("cold start")
    expect(page.locator("#runs-table tbody tr")).to_have_count(1)


def test_what_is_deleted_is_taken_back(runs: BenchPage) -> None:
    page = runs.page
    page.get_by_role("link", name="second").click()
    page.get_by_role("button", name="Delete").click()
    expect(page.locator("#runs-table tbody tr")).to_have_count(1)
    assert len(list(runs.service.folder.glob("*-second"))) == 0
    page.get_by_role("button", name="Undo").click()
    expect(page.locator("#runs-table tbody tr")).to_have_count(2)
    assert len(list(runs.service.folder.glob("*-second"))) == 1


def test_two_runs_stand_side_by_side(runs: BenchPage) -> None:
    page = runs.page
    expect(page.get_by_role("button", name="Compare two")).to_be_disabled()
    for name in ("first", "second"):
        page.get_by_label(f"Compare {name}").check()
    page.get_by_role("button", name="Compare two").click()
    expect(page.get_by_role("heading", name="Two runs side by side")).to_be_visible()
    told = runs.api("GET", "/api/compare", params=dict(zip("ab", compared(page.url), strict=True)))
    expect(page.locator("#view-compare table").first.locator("tbody tr")).to_have_count(len(told["figures"]))
    expect(page.locator("#view-compare .overlay canvas").first).to_be_visible()
    assert violations(page) == []


def compared(address: str) -> list[str]:
    """Ids of the two."""
    return address.partition("#/compare/")[2].split("/")


def test_the_report_is_shown_and_a_file_is_saved(runs: BenchPage) -> None:
    page = runs.page
    page.get_by_role("link", name="first").click()
    page.get_by_role("button", name="Report", exact=True).click()
    report = page.frame_locator("iframe.report")
    expect(report.get_by_role("heading", level=1)).to_be_visible()
    with page.expect_download() as saved:
        page.get_by_role("button", name="result.json").click()
    folder = next(runs.service.folder.glob("*-first"))
    assert Path(saved.value.path()).read_bytes() == (folder / "result.json").read_bytes()


def test_the_trend_of_a_figure_is_drawn_over_the_runs_of_a_device(runs: BenchPage) -> None:
    page = runs.page
    page.get_by_role("link", name="Devices").click()
    page.get_by_role("link", name=re.compile("[0-9a-f]{16}")).click()
    page.get_by_label("Trend of").select_option("innovation_rms")
    values = page.locator("#device tbody td")
    expect(values).to_have_count(2)
    rms = [json.loads(path.read_text())["innovation_rms"] for path in runs.service.folder.glob("*/result.json")]
    wanted = pytest.approx(sorted(1e6 * value for value in rms), rel=1e-3)
    runs.eventually(lambda: sorted(float(text.split()[0]) for text in values.all_inner_texts()) == wanted)
    expect(page.locator("#device canvas")).to_be_visible()


def test_an_older_figure_does_not_replace_the_one_that_was_chosen_since(runs: BenchPage) -> None:
    page, late = runs.page, []
    page.get_by_role("link", name="Devices").click()
    page.route(re.compile(r"/trend\?"), lambda asked: late.append(asked))
    page.get_by_role("link", name=re.compile("[0-9a-f]{16}")).click()
    runs.eventually(lambda: len(late) == 1)
    page.get_by_label("Trend of").select_option("innovation_rms")
    runs.eventually(lambda: len(late) == 2)
    assert "innovation_rms" in late[1].request.url
    assert "innovation_rms" not in late[0].request.url
    late[1].continue_()
    values = page.locator("#device tbody td")
    expect(values).to_have_text([re.compile("V$")] * 2)
    late[0].continue_()
    page.wait_for_timeout(1000)  # nothing tells of an answer that is not used
    expect(values).to_have_text([re.compile("V$")] * 2)


def test_an_address_opens_the_view_it_names(browser: Browser, service: Serving) -> None:
    with BenchPage.opened(browser, service) as page:
        run = page.api("GET", "/api/runs")["runs"][0]
        page.page.goto(f"{service.url}#/runs/{run['id']}")
        expect(page.page.get_by_role("heading", name=run["name"], level=2)).to_be_visible()
        page.page.go_back()
        expect(page.page.get_by_role("heading", name="Bench", level=1)).to_be_attached()
