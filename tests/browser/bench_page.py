"""The page as somebody uses it: by what is written on it."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from playwright.sync_api import Browser, ConsoleMessage, Page, expect

import hil
from tests.service.serving import Serving

PATIENT, LOCKSTEP, BOARD = "patient", "lockstep", "pty:s-slow"
Scheme = Literal["light", "dark"]


def leave_run(folder: Path, name: str, seed: int) -> str:
    """Make a short run below `folder`, as from a notebook, and say what its own folder is called."""
    bench = hil.load_bench("s-slow").with_(loop={"settle_s": 0.5, "duration_s": 2.0, "clock": "lockstep"})
    return hil.run(bench, link="inproc:s-slow", seed=seed, name=name, out=folder).path.name


class BenchPage:
    """One tab. `complaints` is what the browser's console said and what was thrown."""

    def __init__(self, page: Page, service: Serving) -> None:
        self.page = page
        self.service = service
        self.complaints: list[str] = []
        page.on("console", self._hear)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    @classmethod
    @contextmanager
    def opened(
        cls, browser: Browser, service: Serving, *, width: int = 1440, height: int = 900, scheme: Scheme = "light"
    ) -> Iterator["BenchPage"]:
        """The page by the address that the service printed, with what others load from elsewhere refused."""
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        try:
            context.set_default_timeout(60_000)
            shown = cls(context.new_page(), service)
            shown.page.goto(list(service.links.values())[-1])
            expect(shown.page.locator("#service-text")).to_have_text("service connected")
            yield shown
            assert shown.complaints == [], shown.complaints
            shown.leave()
        finally:
            context.close()

    def leave(self) -> None:
        """Go somewhere else, as with a tab that is closed: the lease, if it is this page's, is given back at once."""
        holder = self.page.evaluate("sessionStorage.getItem('gyrohil.name')")
        self.page.goto("about:blank")
        self.eventually(lambda: holder is None or self.holder() != holder)

    def holder(self) -> str | None:
        """Who has the lease of the board."""
        lease = self.api("GET", "/api/lease")["lease"]
        return None if lease is None else lease["holder"]

    def _hear(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(f"{message.type}: {message.text} ({message.location.get('url')})")

    def connect(self, link: str, bench: str) -> None:
        """By the form, up to the board's state."""
        self.page.get_by_label("Bench file").select_option(bench)
        self.page.get_by_label("Link", exact=True).fill(link)
        self.page.get_by_role("button", name="Connect", exact=True).click()
        expect(self.state).to_have_text("SAFE")

    def start(self, seconds: float) -> None:
        """Arm with consent, up to the first samples."""
        self.page.get_by_label("Length").fill(f"{seconds:g}")
        self.page.get_by_role("button", name="Arm and start").click()
        dialog = self.page.get_by_role("dialog")
        expect(dialog).to_contain_text("It may move, heat or break")
        dialog.get_by_role("button", name="Arm and start").click()
        expect(self.state).to_have_text("RUNNING")

    def connect_unless_connected(self, link: str, bench: str) -> None:
        """As `connect`, where an earlier test has not left it so."""
        if not self.api("GET", "/api/board")["connected"]:
            self.connect(link, bench)
        self.settled()

    def disconnect_if_connected(self) -> None:
        """Let the board go."""
        if self.api("GET", "/api/board")["connected"]:
            self.idle()
            self.page.get_by_role("button", name="Disconnect").click()
            expect(self.state).to_have_text("No board")

    def idle(self) -> None:
        """No run is under way, its figures and report are made. (A board in lockstep may have gone with its host.)"""
        self.eventually(lambda: not (told := self.api("GET", "/api/board"))["run"] and not told["stage"], 240.0)

    def settled(self) -> None:
        """As `idle`, and the board is there."""
        self.idle()
        expect(self.state).to_have_text("SAFE")

    def eventually(self, holds: Callable[[], bool], seconds: float = 60.0) -> None:
        """Wait until it does."""
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, "not in time"
            self.page.wait_for_timeout(50)

    def millivolts(self, name: str) -> float:
        """A fact below the pattern."""
        facts = self.page.locator("#pattern-facts")
        names = facts.locator("dt").all_inner_texts()
        value, _, unit = facts.locator("dd").all_inner_texts()[names.index(name)].partition(" ")
        return float(value) if unit == "mV" else float("nan")

    @property
    def state(self) -> Any:
        """The word for the board's state."""
        return self.page.locator("#state-word")

    def api(self, method: str, path: str, **given: Any) -> Any:
        """What the service itself says, not the page."""
        answer = self.service.ask(method, path, **given)
        assert answer.is_success, answer.text
        return answer.json()
