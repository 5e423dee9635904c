"""The whole circle from the page: a run whose model lacks something, its trace, the effect added, a run with it."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

import hil
from hil.bench.examples import find
from tests.browser.bench_page import BenchPage
from tests.service.serving import Serving, serving

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

SETTLE_S = 4.0
SECONDS = 12.0
PATIENCE_MS = 400_000  # of a machine that does other things as well


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A service beside a bench file that does not know of the spring its board has."""
    folder = tmp_path_factory.mktemp("bench")
    text = find("bench", "s-undeclared").read_text()
    for key, old, new in (("clock", '"paced"', '"lockstep"'), ("settle_s", "8.0", f"{SETTLE_S}")):
        text, changed = re.subn(rf"^{key} = {re.escape(old)}$", f"{key} = {new}", text, flags=re.MULTILINE)
        assert changed == 1
    (folder / "unknowing.bench.toml").write_text(text)
    with serving(folder / "runs") as running:
        yield running


def angle_error_rms_rad(run: Path) -> float:
    """Of the reported angle against the rotation that the scenario has: 90 °/s for ten seconds, then −45 °/s."""
    angle = hil.load(run).angle.since(SETTLE_S)
    t = angle.t_s
    true = np.where(t < 10.0, np.radians(90.0) * t, np.radians(900.0) - np.radians(45.0) * (t - 10.0))
    error = (angle.values - angle.values[0]) - (true - true[0])
    return float(np.sqrt(np.mean(error**2)))


def test_run_trace_add_run_makes_the_angle_ten_times_better(browser: Browser, service: Serving, pictures: Path) -> None:
    with BenchPage.opened(browser, service) as page:
        tab = page.page
        page.connect("pty:s-undeclared", "unknowing")
        page.start(SECONDS)
        circle = tab.locator("#circle")
        trace = tab.get_by_role("button", name="Trace this run")
        trace.click(timeout=PATIENCE_MS)
        expect(circle.get_by_role("progressbar", name="Progress of the trace")).to_be_visible()
        add = tab.get_by_role("button", name="Add to the bench file")
        expect(add).to_be_visible(timeout=PATIENCE_MS)
        expect(circle).to_contain_text("explained")
        expect(circle).to_contain_text("cubic stiffness")
        add.click()
        tab.get_by_role("button", name="Arm and run").click()
        expect(tab.get_by_label("Bench file")).to_have_value("unknowing-better")
        tab.get_by_role("dialog").get_by_role("button", name="Arm and start").click()
        side_by_side = tab.get_by_role("link", name="Side by side")
        expect(side_by_side).to_be_visible(timeout=PATIENCE_MS)
        tab.screenshot(path=pictures / "circle.png")
        after, before = [row for row in page.api("GET", "/api/runs")["runs"] if row["kind"] == "run"]
        errors = [angle_error_rms_rad(service.folder / row["folder"]) for row in (before, after)]
        assert before["verdict"] == "failed"
        assert after["verdict"] == "good"
        assert errors[0] >= 10.0 * errors[1], errors
        tab.reload()
        expect(side_by_side).to_be_visible()  # a page that is loaded anew goes on where it was
        side_by_side.click()
        expect(tab.get_by_role("heading", name="Two runs side by side")).to_be_visible()
        expect(tab.get_by_role("region", name="Keys of the bench files")).to_contain_text("cubic_stiffness")
        expect(tab.locator(".overlay canvas").first).to_be_visible()
        tab.screenshot(path=pictures / "compare.png", full_page=True)
