"""Terms that a missing force may have: powers and products of displacement, velocity and drive, with their symmetry.

A term of an axis has the same form on both, in that axis' own displacement q, velocity v, drive u and in those of the
other axis (p, w, s), with a coefficient on each.  A term of the plane is a vector with one coefficient: it is the same
in every direction (r² v), or the gradient of a potential.  Where the law distorts what is sensed and not what pushes,
it is a term of the reading.  Written once, in SymPy and scaled units; threshold and frequencies are numbers that come
from the record.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import sympy as sp

q, v, u, p, w, s = sp.symbols("q v u p w s")
x, y, vx, vy, ux, uy, t = sp.symbols("x y vx vy ux uy t", real=True)
temperature = sp.Symbol("temperature", real=True)
THRESHOLD = sp.Symbol("threshold", positive=True)
"""Stands in the general form of a term for a number that comes from the record."""

_OTHER = {q: (x, y), v: (vx, vy), u: (ux, uy), p: (y, x), w: (vy, vx), s: (uy, ux)}


@dataclass(frozen=True)
class Term:
    """A term with one coefficient or several: each column is what one adds to the axes, in x, y, vx, vy, ux, uy, t.

    form: how it is written; family: that of which it is a member, by a threshold; sense: whether it is sensed and does
    not push; length, time: powers of metre and second of the term itself; axis of each column, None for both;
    threshold: of a family, scaled; series: which series it needs that is no function of the moment; sign: that of its
    coefficients where what it stands for is late, or loses, and never the other way round; price: how many numbers the
    series has taken from the record.
    """

    form: str
    family: str
    columns: tuple[tuple[sp.Expr, sp.Expr], ...]
    length: float
    time: float
    axes: tuple[str, ...]
    sense: bool = False
    threshold: tuple[str, float, int, int] | None = None
    series: str | None = None
    general: tuple[tuple[sp.Expr, sp.Expr], ...] = ()
    rounded: bool = False
    sign: int = 0
    price: int = 0

    @property
    def steep(self) -> bool:
        """Whether the force has a kink or a step, so that it changes within an interval."""
        return self.threshold is not None and self.threshold[0] != "w" and self.series != "z"

    @property
    def name(self) -> str:
        """Unique in a library."""
        value = "" if self.threshold is None else f" [{self.threshold[0]} = {self.threshold[1]:.6g}]"
        return f"{'sense: ' if self.sense else ''}{self.form}{value}"

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the columns: by axis, and, of a wave, by its half."""
        if len(set(self.axes)) == len(self.axes):
            return self.axes
        return tuple(f"{('cos', 'sin')[index % 2]} {axis}" for index, axis in enumerate(self.axes))

    def at(self, value: float) -> "Term":
        """The same with another threshold, scaled."""
        assert self.threshold is not None
        name, _, length, time = self.threshold
        given = {THRESHOLD: sp.Float(value)}
        columns = tuple((one.xreplace(given), two.xreplace(given)) for one, two in self.general)
        return replace(self, columns=columns, threshold=(name, value, length, time))


@dataclass(frozen=True)
class Extent:
    """How far a record goes, scaled: largest |q|, |v|, |u|; frequencies of lines and of modulations that were found;
    whether there is a thermometer, and a drive; whether it is held over each interval, and the largest |du/dt|; the
    largest reading where there is a rail; whether values are lost; how often the reading of each axis
    changes between two levels.
    """

    position: float
    velocity: float
    drive: float
    lines: tuple[float, ...] = ()
    modulations: tuple[float, ...] = ()
    warm: bool = False
    driven: bool = True
    held: bool = True
    steepest: float = 0.0
    rail: float | None = None
    lost: bool = False
    flips: tuple[int, ...] = ()


def library(axes: int, extent: Extent) -> tuple[Term, ...]:
    """All terms for a device of so many axes and a record of this extent."""
    terms = [*_of_an_axis(axes, extent), *_of_reading(axes, extent)]
    if axes == 2:
        terms += _of_the_plane(extent)
    return tuple(terms)


class Law(NamedTuple):
    """A term of one axis: its form in words, its expression, and the powers of a length and of a time in its unit."""

    form: str
    expression: sp.Expr
    length: float
    time: float


def of_axis(
    law: Law,
    *,
    axes: int,
    sense: bool = False,
    threshold: tuple[str, float, int, int] | None = None,
    only: Sequence[int] = (0, 1),
    sign: int = 0,
) -> Term:
    """The same on each axis, with a coefficient of its own."""
    columns: list[tuple[sp.Expr, sp.Expr]] = []
    named = []
    for axis in range(axes):
        if axis not in only:
            continue
        own = law.expression.xreplace({symbol: pair[axis] for symbol, pair in _OTHER.items()})
        zero = sp.Integer(0)
        columns.append((own, zero) if axis == 0 else (zero, own))
        named.append("xy"[axis])
    form, _, length, time = law
    general = Term(
        form, form, tuple(columns), length, time, tuple(named), sense, threshold, None, tuple(columns), sign=sign
    )
    return general if threshold is None else general.at(threshold[1])


_POLYNOMIALS = (
    Law("q²", q**2, 2, 0),
    Law("q³", q**3, 3, 0),
    Law("q⁵", q**5, 5, 0),
    Law("|q| q", sp.Abs(q) * q, 2, 0),
    Law("q² v", q**2 * v, 3, -1),
    Law("|q| v", sp.Abs(q) * v, 2, -1),
    Law("|v| v", sp.Abs(v) * v, 2, -2),
    Law("v³", v**3, 3, -3),
    Law("v²", v**2, 2, -2),
    Law("q v", q * v, 2, -1),
    Law("q v²", q * v**2, 3, -2),
)
_DRIVEN = (
    Law("u²", u**2, 2, -4),
    Law("u³", u**3, 3, -6),
    Law("|u| u", sp.Abs(u) * u, 2, -4),
    Law("q u", q * u, 2, -2),
)
_CROSSED = (
    Law("p²", p**2, 2, 0),
    Law("q p", q * p, 2, 0),
    Law("q² p", q**2 * p, 3, 0),
    Law("p³", p**3, 3, 0),
    Law("q p²", q * p**2, 3, 0),
    Law("p² v", p**2 * v, 3, -1),
    Law("w² q", w**2 * q, 3, -2),
)
_FRICTION = (0.003, 0.01, 0.03, 0.1)
_GAPS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
_LIMITS = (0.05, 0.08, 0.12, 0.18, 0.27, 0.4, 0.55, 0.7, 0.85)
_BANDS = (0.01, 0.03, 0.1, 0.3)
_TOPS = (0.8, 0.85, 0.9, 0.94, 0.97)
_SLEWS = (0.2, 0.35, 0.6, 1.0, 2.0, 4.0, 8.0)
_DECAYS = (0.0003, 0.001, 0.003, 0.01)
_REACHES = (0.05, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4, 0.56)


def _of_an_axis(axes: int, extent: Extent) -> Iterator[Term]:
    for law in _POLYNOMIALS:
        yield of_axis(law, axes=axes)
    for share in _FRICTION:
        speed = ("v0", share * extent.velocity, 1, -1)
        turn = sp.tanh(v / THRESHOLD)
        yield of_axis(Law("tanh(v/v0)", turn, 0, 0), axes=axes, threshold=speed)
        yield of_axis(Law("tanh²(v/v0)", turn**2, 0, 0), axes=axes, threshold=speed)
    for share in _GAPS:
        gap = ("g", share * extent.position, 1, 0)
        yield of_axis(Law("q beyond ±g", _beyond(q), 1, 0), axes=axes, threshold=gap)
    for share in _REACHES:
        reach = ("g", share * extent.position, 1, 0)
        for form, rounded in (("hysteresis of q, reach g", False), ("rounded hysteresis of q, reach g", True)):
            columns, own = _series("z", axes), tuple("xy"[:axes])
            yield Term(form, "hysteresis", columns, 1, 0, own, False, reach, "z", columns, rounded)
    yield of_axis(Law("t q", t * q, 1, 1), axes=axes)
    yield of_axis(Law("t v", t * v, 1, 0), axes=axes)
    if extent.warm:
        yield of_axis(Law("T q", temperature * q, 1, 0), axes=axes)
        yield of_axis(Law("T v", temperature * v, 1, -1), axes=axes)
    for frequency in extent.lines:
        yield _line(axes, frequency, sense=False)
    for frequency in extent.modulations:
        yield _modulated(axes, frequency)
    if not extent.driven:
        return
    for law in _DRIVEN:
        yield of_axis(law, axes=axes)
    if axes == 2:
        yield of_axis(Law("u", u, 1, -2), axes=axes)
        yield of_axis(Law("s", s, 1, -2), axes=axes)
        for law in _CROSSED:
            yield of_axis(law, axes=axes)
    for share in _LIMITS:
        limit = ("L", share * extent.drive, 1, -2)
        yield of_axis(Law("u beyond ±L", _beyond(u), 1, -2), axes=axes, threshold=limit)
    for share in _BANDS:
        band = ("L", share * extent.drive, 1, -2)
        within = u - _beyond(u)
        yield of_axis(Law("u within ±L", within, 1, -2), axes=axes, threshold=band)
    if extent.held:
        # The column is the drive of before less that of now: late is positive.
        yield Term("du/dt", "du/dt", _series("du", axes), 1, -3, tuple("xy"[:axes]), series="du", sign=1)
        for share in _SLEWS if extent.steepest > 0.0 else ():
            slew, columns = ("S", share * extent.steepest, 1, -3), _series("slew", axes)
            yield Term(
                "u slewed at S, less u", "slew", columns, 1, -2, tuple("xy"[:axes]), threshold=slew, series="slewed",
                general=columns, sign=1,
            )  # fmt: skip


def _beyond(what: sp.Expr) -> sp.Expr:
    return (sp.Abs(what + THRESHOLD) - sp.Abs(what - THRESHOLD)) / -2 + what


def _series(name: str, axes: int) -> tuple[tuple[sp.Expr, sp.Expr], ...]:
    """A series of each axis that is no function of the moment."""
    zero = sp.Integer(0)
    both = ((sp.Symbol(f"{name}x"), zero), (zero, sp.Symbol(f"{name}y")))
    return both[:axes]


def _beyond_rail(axes: int) -> tuple[tuple[sp.Expr, sp.Expr], ...]:
    return tuple((_beyond(one), _beyond(two)) for one, two in _series("r", axes))


_WAVES = sp.cos(THRESHOLD * t), sp.sin(THRESHOLD * t)


def _line(axes: int, frequency: float, *, sense: bool) -> Term:
    columns, named = [], []
    for axis in range(axes):
        for wave in _WAVES:
            zero = sp.Integer(0)
            columns.append((wave, zero) if axis == 0 else (zero, wave))
            named.append("xy"[axis])
    threshold, general = ("w", frequency, 0, -1), tuple(columns)
    term = Term("cos(w t), sin(w t)", "line", general, 0, 0, tuple(named), sense, threshold, general=general)
    return term.at(frequency)


def _modulated(axes: int, frequency: float) -> Term:
    general = tuple((wave * x, wave * y if axes == 2 else sp.Integer(0)) for wave in _WAVES)
    threshold = ("w", frequency, 0, -1)
    both = "both" if axes == 2 else "x"
    term = Term(
        "q cos(w t), q sin(w t)", "modulated stiffness", general, 1, 0, (both, both), threshold=threshold,
        general=general,
    )  # fmt: skip
    return term.at(frequency)


def _of_the_plane(extent: Extent) -> Iterator[Term]:
    r2, speed2 = x**2 + y**2, vx**2 + vy**2
    r, speed = sp.sqrt(r2), sp.sqrt(speed2)
    along = x * vx + y * vy

    def plane(form: str, one: sp.Expr, two: sp.Expr, length: float, time: float, family: str | None = None,
              threshold: tuple[str, float, int, int] | None = None) -> Term:  # fmt: skip
        general = Term(
            form, family or form, ((one, two),), length, time, ("both",), threshold=threshold, general=((one, two),)
        )
        return general if threshold is None else general.at(threshold[1])

    yield plane("r² r", r2 * x, r2 * y, 3, 0)
    yield plane("|r| r", r * x, r * y, 2, 0)
    yield plane("r⁴ r", r2**2 * x, r2**2 * y, 5, 0)
    yield plane("r² v", r2 * vx, r2 * vy, 3, -1)
    yield plane("|r| v", r * vx, r * vy, 2, -1)
    yield plane("|v| v", speed * vx, speed * vy, 2, -2, "|v| v of the plane")
    yield plane("|v|² v", speed2 * vx, speed2 * vy, 3, -3)
    yield plane("|v|² r", speed2 * x, speed2 * y, 3, -2)
    yield plane("(r·v) r", along * x, along * y, 3, -1)
    yield plane("(r·v) v", along * vx, along * vy, 3, -2)
    yield plane("r² J v", r2 * vy, -r2 * vx, 3, -1)
    yield plane("J r", y, -x, 1, 0)
    yield plane("r² J r", r2 * y, -r2 * x, 3, 0)
    for share in _FRICTION:
        v0 = ("v0", share * extent.velocity, 1, -1)
        size = sp.sqrt(speed2 + THRESHOLD**2)
        yield plane("v/|v|", vx / size, vy / size, 0, 0, threshold=v0)
    for form, potential, power in (
        ("∇(x² y)", x**2 * y, 2), ("∇(x y²)", x * y**2, 2),
        ("∇(x³ y)", x**3 * y, 3), ("∇(x² y²)", x**2 * y**2, 3), ("∇(x y³)", x * y**3, 3),
    ):  # fmt: skip
        yield plane(form, sp.diff(potential, x), sp.diff(potential, y), power, 0)


def _of_reading(axes: int, extent: Extent) -> Iterator[Term]:
    if axes == 2:
        yield of_axis(Law("q", q, 1, 0), axes=axes, sense=True, only=(1,))
        yield of_axis(Law("p", p, 1, 0), axes=axes, sense=True)
    yield of_axis(Law("q²", q**2, 2, 0), axes=axes, sense=True)
    yield of_axis(Law("q³", q**3, 3, 0), axes=axes, sense=True)
    both = tuple("xy"[:axes])
    # A chain is late or leaks: it knows nothing beforehand, and gives nothing back.
    yield of_axis(Law("v", v, 1, -1), axes=axes, sense=True, sign=-1)
    yield Term("∫q dt", "∫q dt", _series("iq", axes), 1, 1, both, sense=True, series="iq", sign=-1)
    for share in _DECAYS:
        for axis, name in enumerate(both):  # each by itself: it has its own k
            decay = ("k", share, 0, -1)
            dying = Law("exp(-k t)", sp.exp(-THRESHOLD * t), 0, 0)
            term = of_axis(dying, axes=axes, sense=True, threshold=decay, only=(axis,))
            yield replace(term, family=f"decay of {name}")
    for share in _TOPS:
        top = ("L", share * extent.position, 1, 0)
        yield of_axis(Law("q beyond ±L", _beyond(q), 1, 0), axes=axes, sense=True, threshold=top, sign=-1)
    if extent.rail is not None:
        columns = _beyond_rail(axes)
        rail = Term(
            "reading beyond ±L", "q beyond ±L", columns, 1, 0, both, True, ("L", extent.rail, 1, 0), "reading", columns,
            sign=-1,
        )  # fmt: skip
        yield rail.at(extent.rail)
    if extent.lost:
        yield Term(
            "reading less lost values", "lost values", _series("lost", axes), 1, 0, both, True, series="lost", sign=1
        )
    if any(extent.flips):
        switching = [axis for axis, count in enumerate(extent.flips[:axes]) if count]
        columns = tuple(_series("level", axes)[axis] for axis in switching)
        named, price = tuple("xy"[axis] for axis in switching), sum(extent.flips[:axes])
        yield Term("offset of two levels", "levels", columns, 0, 0, named, True, series="levels", price=price)
    yield of_axis(Law("t", t, 0, 1), axes=axes, sense=True)
    if extent.warm:
        yield of_axis(Law("T", temperature, 0, 0), axes=axes, sense=True)
    for frequency in extent.lines:
        yield _line(axes, frequency, sense=True)
    if extent.driven:
        yield of_axis(Law("u", u, 1, -2), axes=axes, sense=True)


def written(term: Term, axis: int) -> str:
    """The term as the axis has it: q, v, u by their names there."""
    if term.axes[0] == "both":
        return term.form
    names = {"q": "xy"[axis], "p": "yx"[axis], "v": ("x'", "y'")[axis], "w": ("y'", "x'")[axis]}
    names |= {"u": ("ux", "uy")[axis], "s": ("uy", "ux")[axis]}
    return replaced(term.form, names)


def replaced(form: str, names: Mapping[str, str]) -> str:
    """Single letters that stand alone, by their names."""
    out = []
    for index, letter in enumerate(form):
        before = form[index - 1] if index else " "
        after = form[index + 1] if index + 1 < len(form) else " "
        alone = not before.isalpha() and not after.isalnum()
        out.append(names.get(letter, letter) if alone else letter)
    return "".join(out)
