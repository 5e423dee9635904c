"""Text of the core as items that can be kept or left out: macros, types, functions, each with its comment."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

_WORD = re.compile(r"[A-Za-z_]\w*")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_STRUCT = re.compile(r"typedef struct \{(.*)\} (\w+);", re.DOTALL)


@dataclass(frozen=True)
class Item:
    """One declaration; `names` are what it defines, `words` what stands in it, comments left out."""

    text: str
    names: frozenset[str]
    words: frozenset[str]

    @property
    def is_macro(self) -> bool:
        return _COMMENT.sub("", self.text).lstrip().startswith("#define")


def chosen(text: str, defined: Mapping[str, str]) -> str:
    """Text with the branches of its conditionals that hold where just these macros are defined, without includes.

    Raises ValueError for a condition that is no name, its negation, or a conjunction of `defined(...)`.
    """
    out, taken = [], [True]
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        if word in ("#ifdef", "#ifndef"):
            taken.append((rest.split()[0] in defined) == (word == "#ifdef"))
        elif word == "#if":
            taken.append(_holds(rest, defined))
        elif word == "#else":
            taken[-1] = not taken[-1]
        elif word == "#endif":
            taken.pop()
        elif all(taken) and word != "#include":
            out.append(line)
    return "\n".join(out) + "\n"


def _holds(condition: str, defined: Mapping[str, str]) -> bool:
    """Whether each `defined(NAME)` or `!defined(NAME)` of a conjunction holds."""
    for term in condition.split("&&"):
        found = re.fullmatch(r"\s*(!?)defined\((\w+)\)\s*", term)
        if found is None:
            raise ValueError(f"a condition of the core that is not understood: {condition}")
        if (found[2] in defined) == (found[1] == "!"):
            return False
    return True


def items(text: str) -> Iterator[Item]:
    """The declarations of a text without conditionals, in their order."""
    at, start, depth = 0, 0, 0
    while at < len(text):
        if text.startswith("/*", at):
            at = text.index("*/", at) + 2
            continue
        mark = text[at]
        if depth == 0 and mark == "#":
            at = _end_of_macro(text, at)
            yield _item(text[start:at])
            start = at
            continue
        depth += (mark in "{(") - (mark in "})")
        at += 1
        if depth == 0 and (mark == ";" or (mark == "}" and _is_function(text[start:at]))):
            at = _rest_of_line(text, at)
            yield _item(text[start:at])
            start = at


def _end_of_macro(text: str, at: int) -> int:
    end = text.index("\n", at)
    while text[end - 1] == "\\":
        end = text.index("\n", end + 1)
    if "/*" in text[at:end] and "*/" not in text[at:end]:
        end = text.index("\n", text.index("*/", end))
    return end


def _rest_of_line(text: str, at: int) -> int:
    """Past a comment on the same line, which belongs to what stands before it."""
    found = re.compile(r"[ \t]*/\*[^\n]*\*/").match(text, at)
    return at if found is None else found.end()


def _is_function(text: str) -> bool:
    head = _COMMENT.sub("", text).lstrip()
    return head.startswith("static") and "(" in head.partition("{")[0] and "=" not in head.partition("{")[0]


def _item(text: str) -> Item:
    bare = _COMMENT.sub("", text)
    words = frozenset(_WORD.findall(bare))
    return Item(text.strip("\n"), frozenset(_defined(bare.strip())), words)


def _defined(bare: str) -> Iterable[str]:
    if bare.startswith("#define"):
        return [bare.split()[1].partition("(")[0]]
    if bare.startswith("typedef"):
        return [_WORD.findall(bare)[-1]] if ")" not in bare.rpartition("}")[2] else _WORD.findall(bare)[1:3]
    if bare.startswith("enum"):
        return _WORD.findall(bare)[1:]
    head = bare.partition("{")[0].partition("=")[0]
    named = re.search(r"(\w+)\s*(?:\(|\[|$)", head.strip())
    return [named[1]] if named else []


def reached(all_items: Iterable[Item], roots: Iterable[str]) -> list[Item]:
    """The items that are named by the roots, and by what they name, in their order."""
    listed = list(all_items)
    by_name = {name: item for item in listed for name in item.names}
    wanted, kept = list(roots), set()
    while wanted:
        item = by_name.get(wanted.pop())
        if item is not None and id(item) not in kept:
            kept.add(id(item))
            wanted += item.words
    return [item for item in listed if id(item) in kept]


def macros(all_items: Iterable[Item]) -> dict[str, str]:
    """Value of each macro without arguments, as text."""
    found = {}
    for item in all_items:
        parts = _COMMENT.sub("", item.text).split(None, 2)
        if parts[0] == "#define" and "(" not in parts[1] and len(parts) == 3:
            found[parts[1]] = parts[2].strip()
    return found


def with_numbers(text: str, values: Mapping[str, str]) -> str:
    """Text with the lengths of its arrays as numbers."""

    def number(found: re.Match[str]) -> str:
        said = found[1]
        while (replaced := _WORD.sub(lambda word: f"({values[word[0]]})", said)) != said:
            said = replaced
        return f"[{_whole(said)}]"

    return re.sub(r"(?<=[\w\]])\[([^\]\[]+)\]", number, text)  # in a comment, a bracket follows a space


def _whole(expression: str) -> int:
    """Value of an expression of whole numbers; as in C, a quotient is cut."""
    if not re.fullmatch(r"[\d\s()+*/-]+", expression):
        raise ValueError(f"not an expression of numbers: {expression}")
    return int(eval(expression.replace("/", "//"), {"__builtins__": {}}))


def struct_of(item: Item) -> tuple[str, str] | None:
    """Body and name of a structure, None of anything else."""
    found = _STRUCT.search(item.text)
    return (found[1], found[2]) if found else None
