"""What the page draws its charts with is known, copied, and named where it cannot be had (`.ci/wheel` asks a wheel)."""

from pathlib import Path

import pytest

import fetch_page


def test_what_the_page_lacks_is_known_and_copied(tmp_path: Path) -> None:
    package, vendor = tmp_path / "node_modules" / "uplot", tmp_path / "vendor"
    for name in fetch_page.FILES:
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(name, encoding="utf-8")
    assert fetch_page.missing(vendor) == list(fetch_page.FILES.values())
    fetch_page.copy(tmp_path / "node_modules", vendor)
    assert fetch_page.missing(vendor) == []
    assert (vendor / "uPlot.esm.js").read_text(encoding="utf-8") == "dist/uPlot.esm.js"


def test_a_build_that_cannot_have_them_ends_with_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetch_page, "_NPM", "import sys; sys.exit(1)")
    with pytest.raises(SystemExit) as ended:
        fetch_page.fetch(tmp_path / "vendor")
    assert "would have no charts" in str(ended.value)
    assert "make install" in str(ended.value)
    assert "\n" not in str(ended.value)
