"""The page's files: what is ours stands beside this module, what is not was fetched by `make install`."""

from pathlib import Path

PAGE = Path(__file__).parent / "page"
_FETCHED = ("uPlot.esm.js", "uPlot.min.css")


def lacking(page: Path = PAGE) -> str:
    """One line on what the page in that folder lacks and how to get it, "" where it is complete."""
    missing = [name for name in _FETCHED if not (page / "vendor" / name).is_file()]
    if not missing:
        return ""
    return f"the page will draw no curves: {' and '.join(missing)} not there; `make install` fetches what is missing"
