"""Keys and values as TOML writes them."""

import json
import re
from typing import Any


def toml_value(value: Any) -> str:
    """A scalar or a list of scalars in TOML.

    >>> toml_value([True, 1e-3, "a"])
    '[true, 0.001, "a"]'
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    return repr(value)


def toml_key(name: str) -> str:
    """A key of TOML, in quotes where it is not bare.

    >>> toml_key("interference"), toml_key("interference:2")
    ('interference', '"interference:2"')
    """
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_value(name)
