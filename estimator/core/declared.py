"""What a C header declares, for Python: numbers and structures are written down there alone.

Addresses are whole numbers here, so that what holds one can be pickled.
"""

import ctypes
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

_TYPES: dict[str, Any] = {
    "double": ctypes.c_double,
    "real": ctypes.c_double,
    "whole": ctypes.c_int64,
    "char": ctypes.c_char,
} | {f"{sign}int{bits}_t": getattr(ctypes, f"c_{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)}
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_UNDEFINED = re.compile(r"^#ifdef .*?(?:^#else\n(.*?))?^#endif\n", re.DOTALL | re.MULTILINE)
_NUMBER = re.compile(r"^#define (\w+) (.+)$", re.MULTILINE)
_STRUCTURE = re.compile(r"typedef struct (?:\w+ )?\{(.*?)\} (\w+);", re.DOTALL)
_CALLED = re.compile(r"[\w ]+\(\*(\w+)\)\(.*\)", re.DOTALL)
_MEMBERS = re.compile(r"(?:const )?(\w+) (.+)", re.DOTALL)
_DECLARATOR = re.compile(r"(\(?\*|)(\w+)\)?((?:\[.+\])?)")


class Header:
    """Headers that were read, one after another, with nothing defined before them but `numbers`."""

    def __init__(self, path: Path, numbers: Mapping[str, int], *more: Path) -> None:
        written = "".join(one.read_text("utf-8") for one in (path, *more))
        text = _UNDEFINED.sub(lambda found: found[1] or "", _COMMENT.sub("", written))
        self.numbers = dict(numbers)
        for name, value in _NUMBER.findall(text):
            try:
                self.numbers[name] = self._number(value)
            except (SyntaxError, NameError, TypeError):  # no whole number
                continue
        self._types = dict(_TYPES)
        for body, name in _STRUCTURE.findall(text):
            members = [member for line in body.split(";") for member in self._members(line.strip())]
            self._types[name] = type(name, (ctypes.Structure,), {"_fields_": members})

    def fields(self, name: str) -> list[tuple[str, Any]]:
        """Of a structure, for a class of one's own."""
        return list(self._types[name]._fields_)

    def size(self, name: str) -> int:
        """Bytes of a structure."""
        return ctypes.sizeof(self._types[name])

    def row(self, name: str) -> np.dtype[np.void]:
        """Of a structure, for arrays of NumPy."""
        return _row(self._types[name])

    def _members(self, line: str) -> list[tuple[str, Any]]:
        if called := _CALLED.fullmatch(line):
            return [(called[1], ctypes.c_int64)]
        if not (found := _MEMBERS.fullmatch(line)):
            return []
        members = []
        for one in found[2].split(", "):
            declarator = _DECLARATOR.fullmatch(one)
            if declarator is None:
                raise ValueError(f"{line}: {one} is no member that this reader knows")
            pointer, name, room = declarator.groups()
            kind = ctypes.c_int64 if pointer else self._types.get(found[1], ctypes.c_int64)
            for length in reversed(room[1:-1].split("][") if room and not pointer else ()):
                kind *= self._number(length)
            members.append((name, kind))
        return members

    def _number(self, text: str) -> int:
        value = eval(re.sub(r"(\d)u\b", r"\1", text).replace("/", "//"), {"__builtins__": {}}, self.numbers)
        if not isinstance(value, int):
            raise TypeError(text)
        return value


def _row(structure: Any) -> np.dtype[np.void]:
    return np.dtype([(member, *_flat(kind)) for member, kind in structure._fields_], align=True)


def _flat(kind: Any) -> tuple[Any, tuple[int, ...]]:
    """What an array of arrays consists of, and its shape."""
    shape: tuple[int, ...] = ()
    while issubclass(kind, ctypes.Array):
        shape, kind = (*shape, kind._length_), kind._type_
    return (_row(kind) if issubclass(kind, ctypes.Structure) else kind), shape
