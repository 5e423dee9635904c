"""A run, as the page shows it and as it is steered from there."""

import json
import math
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from hil.bench.examples import find
from hil.boards.emulation import emulator
from tests.browser.bench_page import BOARD, LOCKSTEP, PATIENT, BenchPage
from tests.service.serving import Serving

pytestmark = pytest.mark.timeout(600)  # the loop goes before the browser on a machine of two processors
_BY_THE_CLOCK = pytest.mark.realtime
_IN_LOCKSTEP = pytest.mark.slow  # no machine is too busy for it

RATE_RAD_S = math.radians(90.0)  # of the scenario, for its first ten seconds


def number(text: str) -> float:
    """As the page writes it."""
    return float(text.replace("−", "-").replace("\u202f", ""))


def moment(page: BenchPage) -> tuple[float, float]:
    """Bench time and angle, read off at one instant."""
    t, angle = page.page.evaluate("['run-time', 'angle-value'].map(id => document.getElementById(id).textContent)")
    return number(t.partition(" ")[0]), number(angle)


def picture(page: BenchPage, canvas: str) -> str:
    """What a canvas shows."""
    shown: str = page.page.locator(canvas).first.evaluate("canvas => canvas.toDataURL()")
    return shown


def zoomed(page: BenchPage) -> bool:
    """Whether the scope, zoomed into twice, shows single samples."""
    for key in "0++":
        page.page.keyboard.press(key)
    page.page.wait_for_timeout(1000)
    return "single samples" in page.page.locator("#scope-readout").inner_text()


@contextmanager
def suspended(process: "subprocess.Popen[bytes]") -> Iterator[None]:
    """It answers nothing, within the block."""
    process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


@pytest.mark.long
@_IN_LOCKSTEP
def test_pattern_and_angle_move_and_agree_with_the_board(page: BenchPage) -> None:
    page.connect(BOARD, LOCKSTEP)  # no browser beside it, however busy the machine, makes an answer late
    assert page.api("GET", "/api/board")["run"] is None, "connecting arms nothing"
    page.start(600.0)
    rows = page.page.locator("#estimates tbody tr")
    expect(rows).to_have_count(13)
    before = {
        name: picture(page, name)
        for name in ("#pattern", "#scope-chart canvas", "#angle-chart canvas", "#spectrum-chart canvas")
    }
    page.eventually(lambda: moment(page)[0] > 3.0)
    begin, angle = moment(page)
    page.eventually(lambda: moment(page)[0] > begin + 3.0)
    end, turned = moment(page)
    assert all(picture(page, name) != shown for name, shown in before.items())
    # the rate is the scenario's, which the emulator knows, and the host does not
    assert (turned - angle) / (end - begin) == pytest.approx(RATE_RAD_S, rel=0.1)
    assert number(page.page.locator("#rate-value").inner_text()) == pytest.approx(RATE_RAD_S, abs=0.2)
    expect(page.page.locator("#rate-spread")).to_have_text(re.compile(r"± [\d.]+ rad/s"))
    expect(page.page.locator("#health")).to_contain_text("answered in time")
    expect(page.page.locator("#drive-x-text")).to_contain_text("m/s²")
    page.page.keyboard.press("Escape")
    expect(page.state).to_have_text("SAFE")
    page.disconnect_if_connected()


@pytest.mark.long
@_IN_LOCKSTEP
def test_settings_act_on_the_loop_that_runs_and_stop_ends_it(page: BenchPage) -> None:
    page.connect(BOARD, LOCKSTEP)
    page.start(600.0)
    page.page.get_by_label("Virtual rotation").fill("4.5")
    page.page.get_by_label("Amplitude").fill("110")
    page.page.get_by_role("button", name="Apply now").click()
    page.eventually(lambda: page.api("GET", "/api/board")["settings"].get("virtual_rotation") == 4.5)
    assert page.api("GET", "/api/board")["settings"]["amplitude"] == pytest.approx(110e-6)
    run = page.api("GET", "/api/board")["run"]
    page.eventually(lambda: page.millivolts("long axis") > 1.05 * 88.5)  # the board's own samples: 885 V/m · 110 µm
    page.page.evaluate(
        """() => { globalThis.words = [];
            const state = document.getElementById("state-word");
            const note = new MutationObserver(() => words.push(state.textContent));
            note.observe(state, { childList: true, characterData: true, subtree: true });
        }"""
    )
    page.page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.state).to_have_text("SAFE")
    expect(page.page.locator("#state-reason")).to_contain_text("INTERRUPTED")
    page.eventually(lambda: "Run ended" in page.page.evaluate("words"), 240.0)  # figures and report made; the board,
    page.settled()  # which waited for its host, has gone with it, and another one is started
    assert "Board lost" not in page.page.evaluate("words")
    changes = [json.loads(line) for line in (page.service.folder / run / "changes.jsonl").read_text().splitlines()]
    assert changes[-1]["virtual_rotation"] == 4.5
    page.disconnect_if_connected()


@pytest.mark.long
@_IN_LOCKSTEP
def test_the_scope_holds_zooms_to_single_samples_and_measures(page: BenchPage) -> None:
    page.connect(BOARD, LOCKSTEP)
    page.start(600.0)
    page.page.get_by_label("Span of the scope").select_option("0.05")
    page.page.get_by_label("Trigger of the scope").select_option("rise")
    chart = page.page.locator("#scope-chart")
    expect(chart.locator("canvas")).to_be_visible()
    expect(page.page.locator("#health")).to_contain_text("answered in time")
    page.page.get_by_role("button", name="Pause").click()
    held = picture(page, "#scope-chart canvas")
    page.page.wait_for_timeout(600)
    assert picture(page, "#scope-chart canvas") == held
    chart.focus()
    page.eventually(lambda: zoomed(page))  # once what is paused is listed, and on the disk
    expect(page.page.locator("#scope-readout")).to_contain_text("single samples, 4.00 kHz")
    page.page.keyboard.press("a")
    page.page.keyboard.press("ArrowLeft")
    page.page.keyboard.press("b")
    page.page.keyboard.press("Shift+ArrowRight")
    expect(page.page.locator("#scope-readout")).to_contain_text(re.compile(r"B − A .*Hz"))
    with page.page.expect_download() as saved:
        page.page.get_by_role("button", name="Save CSV").click()
    lines = Path(saved.value.path()).read_text().splitlines()
    assert lines[0] == "t_s,vx_V,vy_V"
    assert len(lines) > 20
    page.page.keyboard.press("Escape")
    expect(page.state).to_have_text("SAFE")
    page.disconnect_if_connected()


@pytest.mark.beyond(1)
@_BY_THE_CLOCK
@pytest.mark.parametrize("where", ["in a field", "in the dialog", "on another view"])
def test_escape_is_safe_wherever_one_is(page: BenchPage, where: str) -> None:
    page.connect_unless_connected(BOARD, PATIENT)
    page.start(600.0)
    if where == "in a field":
        page.page.get_by_label("Amplitude").focus()
    elif where == "in the dialog":
        page.page.evaluate("document.getElementById('consent').showModal()")
    else:
        page.page.get_by_role("link", name="Runs").click()
        page.page.get_by_label("Search").focus()
    page.page.keyboard.press("Escape")
    expect(page.state).to_have_text("SAFE")
    page.eventually(lambda: page.api("GET", "/api/board")["state"] == "SAFE")
    page.settled()


@_BY_THE_CLOCK
def test_the_bench_of_a_connected_board_is_chosen_on_every_page(browser: Browser, service: Serving) -> None:
    with BenchPage.opened(browser, service) as first:
        first.disconnect_if_connected()
        # Not the one that a page chooses by itself, which is that of the last run.
        bench = LOCKSTEP if first.page.get_by_label("Bench file").input_value() == PATIENT else PATIENT
        first.connect(BOARD, bench)
        with BenchPage.opened(browser, service) as second:
            expect(second.page.get_by_label("Bench file")).to_have_value(bench)
            expect(second.page.get_by_label("Link", exact=True)).to_have_value(BOARD)
            second.page.reload()
            expect(second.page.get_by_label("Bench file")).to_have_value(bench)
        first.disconnect_if_connected()


@_BY_THE_CLOCK
def test_saying_no_arms_nothing(page: BenchPage) -> None:
    page.connect_unless_connected(BOARD, PATIENT)
    page.page.get_by_role("button", name="Arm and start").click()
    dialog = page.page.get_by_role("dialog")
    expect(dialog.get_by_role("button", name="Do not arm")).to_be_focused()
    page.page.keyboard.press("Enter")
    expect(dialog).to_be_hidden()
    page.page.wait_for_timeout(500)
    assert page.api("GET", "/api/board")["run"] is None
    expect(page.state).to_have_text("SAFE")


@_BY_THE_CLOCK
def test_a_lost_board_is_told_and_found_again(browser: Browser, service: Serving) -> None:
    with emulator(find("scenario", "s-slow")) as board, BenchPage.opened(browser, service) as page:
        page.disconnect_if_connected()
        page.connect(board.url, PATIENT)
        with suspended(board.process):
            expect(page.state).to_have_text("Board lost")
        expect(page.state).to_have_text("SAFE")
        page.disconnect_if_connected()


@_BY_THE_CLOCK
def test_a_lost_service_is_told_and_found_again(browser: Browser, service: Serving) -> None:
    with BenchPage.opened(browser, service) as page:
        with suspended(service.process):
            expect(page.state).to_have_text("Service lost")
        expect(page.page.locator("#service-text")).to_have_text("service connected")
        page.complaints.clear()  # the browser tells of sockets that were not opened


_AFTER_A_RESTART = """
const parse = JSON.parse;
JSON.parse = (text) => { const told = parse(text); return told?.kind === "state" ? { ...told, ended: null } : told; };
"""
"""The service knows no more what the loop said last."""


@pytest.mark.long
@_IN_LOCKSTEP
def test_the_dialog_lists_all_that_would_drive_and_a_reload_shows_what_was(page: BenchPage) -> None:
    page.disconnect_if_connected()
    page.connect(BOARD, LOCKSTEP)
    page.page.get_by_label("Amplitude").fill("110")
    page.page.get_by_label("Length").fill("9")
    page.page.get_by_role("button", name="Arm and start").click()
    facts = page.page.locator("#consent-facts")
    expect(facts).to_contain_text("110 µm (a setting; the bench file says 100 µm)")
    for told in (
        "largest drive",
        "10 m/s²",
        "target stiffness",
        "virtual rotation",
        "3 rad/s",
        "0.3 m/s² rms",
        "watchdog",
    ):
        expect(facts).to_contain_text(told)
    page.page.get_by_role("dialog").get_by_role("button", name="Arm and start").click()
    page.eventually(lambda: page.api("GET", "/api/board")["last_run"] is not None, 240.0)
    page.idle()
    folder = page.service.folder / page.api("GET", "/api/board")["last_run"]
    assert "amplitude_m = 0.00011" in (folder / "bench.toml").read_text()
    expect(page.page.get_by_label("Amplitude")).to_have_value("")  # it was for that run
    angle = page.page.locator("#angle-value").inner_text()
    expect(page.page.locator("#angle-spread")).to_contain_text("before the closing scan")
    page.page.reload()
    expect(page.page.locator("#angle-value")).to_have_text(angle)
    expect(page.page.locator("#estimates tbody tr")).to_have_count(13)
    expect(page.page.locator("#circle")).to_be_visible()
    expect(page.page.locator("#scope-readout")).to_contain_text("single samples")
    expect(page.page.get_by_label("Amplitude")).to_have_value("")
    page.page.get_by_role("button", name="Arm and start").click()
    expect(facts).to_contain_text("100 µm")
    expect(facts).not_to_contain_text("a setting")
    page.page.get_by_role("button", name="Do not arm").click()
    page.page.add_init_script(_AFTER_A_RESTART)
    page.page.reload()
    for name in ("#angle-value", "#rate-value", "#pattern-facts dd >> nth=0"):
        expect(page.page.locator(name)).to_have_text(re.compile(r"\d"))
    page.disconnect_if_connected()
