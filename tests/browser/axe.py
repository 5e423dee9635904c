"""What axe-core has against a page."""

import sys
from pathlib import Path
from typing import Any

from playwright.sync_api import Page

AXE = Path(sys.prefix) / "node/node_modules/axe-core/axe.min.js"


def violations(page: Page) -> list[str]:
    """As the page is now: the rule that is broken, and by what."""
    page.evaluate(AXE.read_text())
    found: dict[str, Any] = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [f"{one['id']}: {node['html'][:160]}" for one in found["violations"] for node in one["nodes"]]
