"""What a TOML text may have at most, looked at before it is parsed.

A parser takes a key of 49,000 dots for minutes and gigabytes, and a number or a nesting without end until Python gives
up.  This looks at the text once, in a time that its length bounds.
"""

import re

MOST_BYTES = 1 << 20
_MOST_DEPTH = 32  # of brackets within one another
_MOST_DOTS = 16  # in a key, or a table's name
_MOST_LONG = 400  # characters of a number, or of a key without quotes

_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|[A-Za-z0-9_+-]+|[ \t]+|.',
    re.DOTALL,
)


def beyond(text: str) -> str | None:
    """What of `text` is beyond any file of a bench, with its line; None where nothing is."""
    depth = dots = 0
    for found in _TOKEN.finditer(text):
        token = found[0]
        if token[0] in "[{":
            depth, dots = depth + 1, 0
        elif token[0] in "]}":
            depth, dots = depth - 1, 0
        elif token == ".":
            dots += 1
        elif token[0] in "\n,=#":
            dots = 0
        elif len(token) > _MOST_LONG and token[0] not in "\"'":
            return f"line {_line(text, found)}: a number or a key of {len(token)} characters; {_MOST_LONG} are the most"
        if depth > _MOST_DEPTH:
            return f"line {_line(text, found)}: nested too deeply; {_MOST_DEPTH} levels are the most, write it flat"
        if dots > _MOST_DOTS:
            return f"line {_line(text, found)}: a key of more than {_MOST_DOTS} dots; write its table with less"
    return None


def _line(text: str, found: re.Match[str]) -> int:
    return text.count("\n", 0, found.start()) + 1
