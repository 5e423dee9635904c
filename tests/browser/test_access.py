"""For everybody: by keyboard alone, with a screen reader, on a laptop and a phone, in light and in dark; offline."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Request, expect

from tests.browser.axe import violations
from tests.browser.bench_page import BOARD, LOCKSTEP, BenchPage, Scheme, leave_run
from tests.service.serving import Serving

pytestmark = pytest.mark.slow  # of boards in lockstep: no machine is too busy for them

SIZES = {1440: 900, 820: 1180, 390: 844}


@pytest.mark.long
def test_a_run_in_every_size_and_in_light_and_dark(browser: Browser, service: Serving, pictures: Path) -> None:
    """One run, looked at by six pages; of each a picture, and no violation on any."""
    with BenchPage.opened(browser, service) as first:
        asked: list[str] = []
        first.page.on("request", lambda request: asked.append(_of(request)))
        first.connect(BOARD, LOCKSTEP)
        first.start(600.0)
        for width, height in SIZES.items():
            for scheme in ("light", "dark"):
                found = _looked_at(browser, service, pictures, width, height, scheme)
                assert found == [], f"{width} px, {scheme}"
        first.page.keyboard.press("Escape")
        first.idle()
        expect(first.page.locator("#circle")).to_be_visible()
        assert violations(first.page) == []
        first.page.screenshot(path=pictures / "after-the-run.png", full_page=True)
        assert {address for address in asked if not address.startswith(service.url)} == set()


def _of(request: Request) -> str:
    return request.url.replace("ws:", "http:").replace("blob:", "")


def _looked_at(
    browser: Browser, service: Serving, pictures: Path, width: int, height: int, scheme: Scheme
) -> list[str]:
    with BenchPage.opened(browser, service, width=width, height=height, scheme=scheme) as page:
        expect(page.page.locator("#estimates tbody tr")).to_have_count(13)
        expect(page.page.locator("#spectrum-chart canvas")).to_be_visible()
        page.page.wait_for_timeout(1200)
        page.page.screenshot(path=pictures / f"live-{width}-{scheme}.png", full_page=True)
        overflow = page.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        assert overflow == 0, "the page scrolls sideways"
        return violations(page.page)


@pytest.fixture(scope="module")
def run(service: Serving) -> str:
    """A run of the catalogue, made beside the service."""
    return leave_run(service.folder, "looked-at", seed=1)


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", SIZES)
def test_no_view_has_a_violation(
    browser: Browser, service: Serving, pictures: Path, run: str, width: int, scheme: Scheme
) -> None:
    with BenchPage.opened(browser, service, width=width, height=SIZES[width], scheme=scheme) as page:
        (row,) = (row for row in page.api("GET", "/api/runs")["runs"] if row["id"] == run)
        views = ["bench", "runs", f"runs/{run}", "devices", f"devices/{row['serial']}", "jobs"]
        found = {}
        for view in views:
            page.page.goto(f"{service.url}#/{view}")
            page.page.wait_for_load_state("networkidle")
            page.page.wait_for_timeout(200)
            found[view] = violations(page.page)
            page.page.screenshot(
                path=pictures / f"{view.split('/')[0]}{'-one' if '/' in view else ''}-{width}-{scheme}.png"
            )
        assert {view: said for view, said in found.items() if said} == {}


@pytest.mark.long
def test_a_board_is_connected_armed_and_stopped_by_keyboard_alone(browser: Browser, service: Serving) -> None:
    with BenchPage.opened(browser, service) as page:
        page.disconnect_if_connected()
        page.page.reload()
        expect(page.state).to_have_text("No board")
        keys = page.page.keyboard
        keys.press("Tab")
        expect(page.page.get_by_role("link", name="Skip to the content")).to_be_focused()
        keys.press("Enter")
        tab_to(page, "#bench")
        keys.type("lockstep")
        tab_to(page, "#link")
        keys.press("Control+A")
        keys.type(BOARD)
        keys.press("Enter")
        expect(page.state).to_have_text("SAFE")
        tab_to(page, "#duration")
        keys.press("Control+A")
        keys.type("600")
        keys.press("Enter")
        expect(page.page.get_by_role("dialog")).to_be_visible()
        expect(page.page.locator("#consent-no")).to_be_focused()
        assert violations(page.page) == []
        keys.press("Tab")
        expect(page.page.locator("#consent-yes")).to_be_focused()
        keys.press("Enter")
        expect(page.state).to_have_text("RUNNING")
        tab_to(page, "#scope-chart")
        keys.press("Space")
        expect(page.page.locator("#scope-pause")).to_have_attribute("aria-pressed", "true")
        tab_to(page, "#safe")
        keys.press("Enter")
        expect(page.state).to_have_text("SAFE")
        page.settled()


def tab_to(page: BenchPage, wanted: str) -> None:
    """Press Tab until the focus is there, once around at most."""
    for _ in range(80):
        if page.page.evaluate("wanted => document.activeElement?.matches(wanted)", wanted):
            return
        page.page.keyboard.press("Tab")
    raise AssertionError(f"{wanted} is not reached by Tab")
