"""What the site of `make docs` needs beside mkdocs.yml.

The README is its front page. Headings have the anchors that a forge gives them, so that one link serves both. What a
link names outside of docs/ stays a name: the site has pages only.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

TREE = Path(__file__).parent
FROM_THE_TOP = {"index.md": "README.md", "changelog.md": "CHANGELOG.md"}

_LINK = re.compile(r"(?<!!)\[(?P<text>[^\]]*)\]\((?P<target>[^)\s]+)\)")
_PICTURE = re.compile(r"(!\[[^\]]*\]\()docs/")
_CODE = re.compile(r"(?<=<code>)[^<]*(?=</code>)")
_FENCE = re.compile(r"(^```.*?^```)", re.MULTILINE | re.DOTALL)


def anchor(heading: str, separator: str = "-") -> str:
    """As a forge makes it: small letters, spaces as hyphens, other signs left out."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", separator)


def on_config(config: Any) -> Any:
    config.mdx_configs.setdefault("toc", {})["slugify"] = anchor
    decisions = next(one["Decisions"] for one in config.nav if "Decisions" in one)
    decisions += sorted(f"decisions/{page.name}" for page in (TREE / "docs" / "decisions").glob("[0-9]*.md"))
    return config


def on_files(files: Files, config: Any) -> Files:
    for page, source in FROM_THE_TOP.items():
        files.append(File.generated(config, page, content=(TREE / source).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    name = page.file.src_uri
    folder = "" if name in FROM_THE_TOP else posixpath.dirname(f"docs/{name}")

    def mended(link: re.Match[str]) -> str:
        target, hash_, part = link["target"].partition("#")
        if not target or "://" in target or target.startswith("mailto:"):
            return link[0]
        place = posixpath.normpath(posixpath.join(folder, target))
        if not (TREE / place).exists():
            raise PluginError(f"{name}: nothing is at {place}, which a link names")
        own = {source: made for made, source in FROM_THE_TOP.items()}
        if place in own or place.startswith("docs/"):
            inside = own.get(place, place.removeprefix("docs/"))
            return f"[{link['text']}]({posixpath.relpath(inside, posixpath.dirname(name) or '.')}{hash_}{part})"
        return link["text"] if place in link["text"] else f"{link['text']} (`{place}`)"

    pieces = _FENCE.split(_PICTURE.sub(r"\1", markdown) if folder == "" else markdown)
    return "".join(one if one.startswith("```") else _LINK.sub(mended, one) for one in pieces)


def on_page_content(html: str, **_: Any) -> str:
    """A bar in the code of a table has a backslash before it, which a forge takes away."""
    pieces = re.split(r"(<table>.*?</table>)", html, flags=re.DOTALL)
    pieces[1::2] = [_CODE.sub(lambda code: code[0].replace("\\|", "|"), table) for table in pieces[1::2]]
    return "".join(pieces)
