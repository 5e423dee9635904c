"""The page as files: nothing of it comes from elsewhere, and the service says what it lacks."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args

import pytest

from hil.records.diagnosis import Diagnosis
from hil.records.result import RunVerdict
from hil.service.app import PAGE, lacking
from tests.service.serving import Serving

OURS = sorted(path for path in PAGE.iterdir() if path.is_file())
MODULES = [path for path in OURS if path.suffix == ".js"]


class _Seen(HTMLParser):
    """What the policy would refuse: styles and scripts that are in the text itself."""

    def __init__(self) -> None:
        super().__init__()
        self.inline: list[str] = []
        self.named: list[str] = []
        self._within = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._within = tag
        self.inline += [f"{tag} {name}" for name, _ in attrs if name == "style" or name.startswith("on")]
        self.named += [value or "" for name, value in attrs if name in ("src", "href") and tag != "a"]

    def handle_endtag(self, tag: str) -> None:
        self._within = ""

    def handle_data(self, data: str) -> None:
        if self._within in ("script", "style") and data.strip():
            self.inline.append(self._within)


def test_nothing_is_inline_and_nothing_is_loaded_from_elsewhere() -> None:
    seen = _Seen()
    seen.feed((PAGE / "index.html").read_text())
    assert seen.inline == []
    ours = [name for name in seen.named if not name.startswith("vendor/")]
    assert ours
    assert [name for name in ours if not (PAGE / name).is_file()] == []
    addresses = [
        address
        for path in OURS
        for address in re.findall(r"https?://[^\s\"'`)]+", path.read_text())
        if address != "http://www.w3.org/2000/svg"  # a name, which nobody looks up
    ]
    assert addresses == []


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.stem)
def test_every_module_that_is_imported_is_there(module: Path) -> None:
    imported = re.findall(r"(?:from|import|import\() ?\"(\./[^\"]+)\"", module.read_text())
    assert [name for name in imported if not name.startswith("./vendor/") and not (PAGE / name).is_file()] == []


def test_every_module_is_imported_by_another() -> None:
    texts = {path.name: path.read_text() for path in MODULES}
    imported = {name for text in texts.values() for name in re.findall(r"from \"\./([^\"]+)\"", text)}
    assert set(texts) - imported == {"main.js"}


def test_the_page_knows_every_verdict_by_its_name() -> None:
    verdicts = {*get_args(RunVerdict), *get_args(Diagnosis.model_fields["verdict"].annotation)}
    (offered,) = re.findall(r"const VERDICTS = (\[.*\]);", (PAGE / "runs.js").read_text())
    assert set(json.loads(offered)) == verdicts
    (tones,) = re.findall(r"const TONES = .*?\(\{(.*?)\}\);", (PAGE / "verdict.js").read_text(), re.DOTALL)
    assert verdicts <= {name.strip('" ') for name in re.findall(r"([^,:\n]+):", tones)}


def test_the_lock_file_names_no_address() -> None:
    locked = json.loads((PAGE.parents[2] / "package-lock.json").read_text())
    packages = {name: entry for name, entry in locked["packages"].items() if name}
    assert {"node_modules/uplot", "node_modules/typescript", "node_modules/axe-core"} <= set(packages)
    assert all("resolved" not in entry and entry["integrity"].startswith("sha512-") for entry in packages.values())


def test_what_was_not_fetched_is_told_in_one_line_with_the_remedy(tmp_path: Path) -> None:
    line = lacking(tmp_path)
    assert line.count("\n") == 0
    assert "uPlot.esm.js" in line
    assert "make install" in line
    (tmp_path / "vendor").mkdir()
    for name in ("uPlot.esm.js", "uPlot.min.css"):
        (tmp_path / "vendor" / name).touch()
    assert lacking(tmp_path) == ""


@pytest.mark.moderate
def test_the_service_gives_the_page_out_with_the_right_types(service: Serving) -> None:
    for name, kind in {
        "": "text/html",
        "main.js": "text/javascript",
        "style.css": "text/css",
        "icon.svg": "image/svg+xml",
    }.items():
        answer = service.ask("GET", f"/{name}", token="")
        assert answer.status_code == 200, name
        assert answer.headers["content-type"].startswith(kind)
        assert "unsafe-inline" not in answer.headers["content-security-policy"]
