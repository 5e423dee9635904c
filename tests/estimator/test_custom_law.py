"""Laws as text: what is arithmetic means what it says, the rest is refused in one line, quickly, and nothing is run."""

import math
import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.custom import Coefficient, Declaration, Parameter
from estimator.custom.grammar import FUNCTIONS, LARGEST_EXPONENT, LONGEST, names_in, parsed
from estimator.custom.law import DIRECTIONS, expression
from estimator.custom.names import QUANTITIES
from estimator.custom.unit import Unit, unit_of
from estimator.errors import ModelError

NAMES = ("x", "y", "vx", "vy", "r", "v", "k")
NUMPY: dict[str, Callable[[float], float]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tanh": np.tanh,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "abs": np.abs,
}
VALUES = {"x": 0.7, "y": -0.4, "vx": 0.3, "vy": 0.9, "k": 1.3}

HOSTILE = [
    "__import__('os').system('touch /tmp/owned')",
    "__import__",
    "x.__class__.__mro__",
    "().__class__",
    "x.real",
    "(lambda: 1)()",
    "lambda",
    "[k for k in (1,)]",
    "{x}",
    "{'a': 1}",
    "x[0]",
    "f'{x}'",
    "'a' * 9",
    "b'a'",
    "x := 3",
    "x if y else k",
    "x and y",
    "not x",
    "x < y",
    "x == y",
    "x is y",
    "x in y",
    "x // y",
    "x % y",
    "x @ y",
    "x << 9",
    "x | y",
    "x & y",
    "~x",
    "x, y",
    "*x",
    "sin(*x)",
    "sin(x, y)",
    "sin(x=1)",
    "sin()",
    "sin(x)(y)",
    "(sin)(x)(y)",
    "sin.cos(x)",
    "eval(x)",
    "print(x)",
    "open(x)",
    "getattr(x)",
    "Sum(x)",
    "await x",
    "yield x",
    "import os",
    "x; y",
    "x\\\ny",
    "x = y",
    "# x",
    "None",
    "True",
    "...",
    "1j",
    "x * 1e999",
    "x * -1e999",
    "9" * 400,
    "9**9**9",
    "9**(9**9)",
    "2**x",
    "x**y",
    "x**99",
    "x**-99",
    "x**1e9",
    "x**nan",
    "((x**9)**9)**9",
    "((((x**2)**2)**2)**2)**2",
    "10.0**12**12",
    "(1e300)**9",
    "1/0",
    "x/0",
    "0**-1",
    "x/(1-1)",
    "sqrt(-1)",
    "exp(1e4)",
    "(-8)**0.5",
    "",
    "   ",
    "(" * 10_000 + "x" + ")" * 10_000,
    "-" * 400 + "x",
    "+" * 499 + "x",
    "sin(" * 60 + "x" + ")" * 60,
    "x" + "+x" * 300,
    "x" * 1_000_000,
    "x+" * 500_000 + "x",
    "(" * 1_000_000,
    "х",  # Cyrillic
    "ｘ",  # full width, which Python takes for x
    "𝑥",  # mathematical italic, which Python takes for x
    "x²",
    "x·y",
    "x − y",
    "x\u200b",
    "x\u202ey",
    "x\x00",
    "\ud800",
    "(x",
    "x)",
    "x +",
    "* x",
    "x x",
    "0x",
    "1_",
    "1if x else y",
    "x or y",
]


RUNS = ("exec", "import", "open", "os.system", "subprocess.Popen")


class Watch:
    """Events of the interpreter that mean that something was run; one hook for all tests, as none can be taken out."""

    def __init__(self) -> None:
        self.on = False
        self.seen: list[str] = []
        self.thread = threading.get_ident()
        sys.addaudithook(self._note)

    def _note(self, event: str, _: Any) -> None:
        if (
            self.on
            and threading.get_ident() == self.thread
            and event in ("exec", "import", "open", "os.system", "subprocess.Popen")
        ):
            self.seen.append(event)


@cache
def watch() -> Watch:
    return Watch()


def refusal(text: str) -> str:
    """The one line that refuses a law, at once, with nothing run."""
    eye = watch()
    eye.seen.clear()
    begin = time.thread_time()
    eye.on = True
    try:
        with pytest.raises(ModelError) as error:
            parsed(text)
    finally:
        eye.on = False
    assert time.thread_time() - begin < 0.5
    assert eye.seen == []
    said = str(error.value)
    assert "\n" not in said
    assert said.isprintable()
    assert len(said) < 300
    return said


def test_the_watch_would_see_it() -> None:
    eye = watch()
    eye.seen.clear()
    eye.on = True
    exec("x = 1")
    eye.on = False
    assert eye.seen == ["exec"]


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text[:20]))
def test_more_than_arithmetic_is_refused(text: str) -> None:
    assert ";" in refusal(text)  # what is wrong; what to do


def test_the_line_names_place_and_remedy() -> None:
    assert refusal("x + 'a'") == "''' at character 5; a law has numbers, names, + - * / ** and parentheses only"
    assert refusal("-k * х").startswith("'х' at character 6; that is CYRILLIC SMALL LETTER HA")
    assert refusal("k * x^3") == "'^' at character 6; write ** for a power"
    assert refusal("k * x**x").startswith("exponent 'x': no number")
    assert refusal("k * x.real").startswith("'x.real' is more than arithmetic")


def said(text: str) -> str | None:
    """How a law is refused, None for one that stands."""
    try:
        node = parsed(text)
        own = {name: sp.Symbol(name) for name in names_in(node) - set(QUANTITIES)}
        expression(node, own)
    except ModelError as error:
        return str(error)
    return None


@pytest.mark.slow
@given(st.one_of(st.text(max_size=60), st.text(alphabet="xyk0129.+-*/() esin", max_size=60)))
@settings(max_examples=800, deadline=1000)
def test_any_text_is_a_law_or_refused_in_one_line(text: str) -> None:
    line = said(text)
    assert line is None or ("\n" not in line and line.isprintable() and len(line) < 300)


def laws() -> st.SearchStrategy[str]:
    """Texts of laws without poles or roots of what is negative."""
    leaves = st.one_of(st.sampled_from(NAMES), st.floats(-3, 3, allow_nan=False).map(lambda value: f"({value:.4g})"))

    def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        return st.one_of(
            st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
            st.tuples(inner, inner).map(lambda t: f"({t[0]} / (2 + tanh({t[1]})))"),
            st.tuples(inner, st.sampled_from(["2", "3"])).map(lambda t: f"({t[0]})**{t[1]}"),
            st.tuples(inner, st.sampled_from(["sin", "cos", "tanh", "abs"])).map(lambda t: f"{t[1]}({t[0]})"),
            inner.map(lambda t: f"sqrt(1 + abs({t}))"),
            inner.map(lambda t: f"-({t})"),
        )

    return st.recursive(leaves, grown, max_leaves=6)


@pytest.mark.slow
@given(laws())
@settings(max_examples=200, deadline=None)
def test_a_law_means_what_python_means_by_it(text: str) -> None:
    try:
        node = parsed(text)
    except ModelError:
        return  # too long, deep or steep
    symbols = {name: sp.Symbol(name) for name in VALUES}
    built = expression(node, {"k": symbols["k"]})
    found = complex(built.subs({symbols[name]: value for name, value in VALUES.items()}).evalf())
    speed = math.hypot(VALUES["vx"], VALUES["vy"])
    scope = {**NUMPY, **VALUES, "r": math.hypot(VALUES["x"], VALUES["y"]), "v": speed, "__builtins__": {}}
    meant = float(eval(text, scope))  # the test's own text, and an independent reading of it
    assert found.imag == 0.0
    assert found.real == pytest.approx(meant, rel=1e-6, abs=1e-6)


def test_nested_fractions_are_not_split_into_real_and_imaginary(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """SymPy splits the argument of a hyperbolic tangent to learn whether it is real: of this law, for minutes."""
    for split in (sp.Add, sp.Mul, sp.Pow):
        monkeypatch.setattr(split, "as_real_imag", lambda *_, **__: pytest.fail("a law was split"))
    law = "cos(abs(vx) / (2 + tanh(r / (2 + tanh(v)))) - sqrt(1 + abs(cos(vy))))"
    built = expression(parsed(law), {})
    slope = sp.diff(built, sp.Symbol("vx"))
    at = {sp.Symbol(name): value for name, value in VALUES.items()}
    r = math.hypot(VALUES["x"], VALUES["y"])

    def meant(vx: float) -> float:
        speed = math.hypot(vx, VALUES["vy"])
        inner = abs(vx) / (2 + math.tanh(r / (2 + math.tanh(speed))))
        return math.cos(inner - math.sqrt(1 + abs(math.cos(VALUES["vy"]))))

    assert float(built.subs(at)) == pytest.approx(meant(VALUES["vx"]))
    assert float(slope.subs(at)) == pytest.approx((meant(0.3 + 1e-6) - meant(0.3 - 1e-6)) / 2e-6, rel=1e-6)


@pytest.mark.moderate
def test_roots_and_poles_do_not_stop_an_observer_at_rest() -> None:
    for text in ("sqrt(x)", "abs(x)", "r", "v", "abs(x)**1.5", "x * r**3", "vx * v", "vx / v", "sqrt(x**2 + y**2)"):
        built = expression(parsed(text), {})
        for by in (sp.Symbol("x"), sp.Symbol("vx"), None):
            slope = built if by is None else sp.diff(built, by)
            for place in (0.0, -0.5, 0.5):
                at = {sp.Symbol(name): place for name in ("x", "y", "vx", "vy")}
                assert np.isfinite(complex(slope.subs(at))), (text, by, place)
    assert float(expression(parsed("sqrt(x)"), {}).subs({"x": -2.0})) == pytest.approx(0.0, abs=1e-8)
    assert float(expression(parsed("sqrt(x)"), {}).subs({"x": 2.0})) == pytest.approx(math.sqrt(2.0))


@pytest.mark.parametrize("times", [2, 4, 6, -2, -6])
@pytest.mark.parametrize("function", ["sin", "cos"])
@pytest.mark.parametrize("theta", [0.3, 2.0, -1.1])
@pytest.mark.parametrize("phi", [0.4, 2.5])
def test_orientation_and_phase_are_those_of_a_line(times: int, function: str, theta: float, phi: float) -> None:
    """x = A cos θ cos φ, ẋ = −A cos θ sin φ (ω0 = 1), y alike with sin θ."""
    state = {
        "x": math.cos(theta) * math.cos(phi),
        "vx": -math.cos(theta) * math.sin(phi),
        "y": math.sin(theta) * math.cos(phi),
        "vy": -math.sin(theta) * math.sin(phi),
    }
    at = {sp.Symbol(name): 0.8 * value for name, value in state.items()}
    for name, angle in (("orientation", theta), ("phase", phi)):
        found = expression(parsed(f"{function}({times} * {name})"), {})
        assert float(found.subs(at)) == pytest.approx(getattr(math, function)(times * angle), abs=1e-9)


def test_the_sign_of_a_velocity_is_that_of_dry_friction() -> None:
    assert expression(parsed("-sign(vx)"), {}) == -DIRECTIONS[0]
    other = expression(parsed("sign(x)"), {})
    assert float(other.subs({"x": 0.3})) == pytest.approx(1.0, abs=1e-9)
    assert float(other.subs({"x": -0.3})) == pytest.approx(-1.0, abs=1e-9)


@pytest.mark.moderate
@given(st.tuples(*[st.integers(-9, 9)] * 4))
def test_a_unit_is_read_as_it_is_written(powers: tuple[int, int, int, int]) -> None:
    unit = unit_of("1") * Unit(tuple(sp.Rational(power) for power in powers))  # type: ignore[arg-type]
    assert unit_of(str(unit)).powers == unit.powers


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("1/(m⁴·s²)", "m^-4 s^-2"),
        ("1/(m^4 s^2)", "1/(m**4*s**2)"),
        ("m/s²", "m s-2"),
        ("Hz", "1/s"),
        ("rad/s", "1/s"),
        ("V/m", "m⁻¹ V"),
    ],
)
def test_spellings_of_a_unit(text: str, same: str) -> None:
    assert unit_of(text) == unit_of(same)


@pytest.mark.parametrize(
    "text", ["", "kg", "1/m⁴ s²", "1/m/s", "m^x", "(m", "m)", "/m", "m^999", "mm", "m" * 99, "m\n*"]
)
def test_what_is_no_unit_is_refused(text: str) -> None:
    with pytest.raises(ModelError) as error:
        unit_of(text)
    assert "\n" not in str(error.value)
    assert "1/(m⁴·s²)" in str(error.value)


def declared(force_x: str = "", unit: str = "1/s²", **more: Any) -> Declaration:
    return Declaration("mine", force=(force_x, ""), coefficients={"q": Coefficient(unit)}, **more)


@pytest.mark.parametrize(
    ("law", "unit", "right"),
    [
        ("-q * x * r**4", "1/(m²·s²)", "1/(m⁴·s²)"),
        ("-q * vx", "m", "1/s"),
        ("q * ux * x**2", "1", "1/m²"),
        ("-q**2 * x", "1/s²", "1/s"),
        ("x / q", "s", "s²"),
        ("q", "1", "m/s²"),
        ("-q * T * x", "1/s²", "1/(s²·K)"),
        ("q * omega0 * vx * rate / omega0", "1/s", "1"),
    ],
)
def test_the_line_says_which_unit_it_should_be(law: str, unit: str, right: str) -> None:
    with pytest.raises(ModelError, match="the unit of q should be") as error:
        declared(law, unit)
    said = str(error.value).partition("should be ")[2].partition(", not")[0]
    assert unit_of(said) == unit_of(right)
    declared(law, said)  # and with that unit it stands


@pytest.mark.parametrize(
    ("law", "complaint"),
    [
        ("q * x + 3", "it needs a factor in m/s²"),
        ("q * x + vx", "it needs a factor in 1/s"),
        ("q * (x + 1)", "cannot be added; divide by amplitude"),
        ("q * (x + vx)", "cannot be added; multiply one by"),
        ("q * x * sin(x)", "sin(x): of a plain number, not of m"),
        ("q * x * exp(t)", "not of s"),
        ("q * x * sqrt(x)", "divide by amplitude or omega0 until its powers are whole"),
        ("q * x * z", "unknown name 'z'"),
        ("q * x * phase", "even"),
        ("q * x * sin(phase)", "even"),
        ("q * x * sin(3 * phase)", "even"),
        ("q * x * tanh(2 * phase)", "even"),
        ("3", "a mere number"),
    ],
)
def test_units_that_do_not_fit_are_refused(law: str, complaint: str) -> None:
    with pytest.raises(ModelError) as error:
        declared(law)
    assert complaint in str(error.value)
    assert str(error.value).startswith("force_x: ")


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"name": "Mine"}, "name: begins with a small letter"),
        ({"name": "custom"}, "name: "),
        ({"coefficients": {}}, "coefficients: missing"),
        ({"force": ("", "")}, "force_x: missing"),
        ({"coefficients": {"q": Coefficient("1/s²"), "p": Coefficient("1")}}, "coefficients.p: in none of the laws"),
        ({"coefficients": {"x": Coefficient("1/s²")}}, "coefficients.x: that name has a meaning"),
        ({"coefficients": {"if": Coefficient("1/s²")}}, "coefficients.if: that name has a meaning"),
        ({"coefficients": {"q;": Coefficient("1/s²")}}, "coefficients: a name has letters"),
        ({"coefficients": {"q": Coefficient("banana")}}, "coefficients.q.unit: unit 'banana' is none"),
        ({"parameters": {"q": Parameter("1", 1.0)}}, "parameters.q: a coefficient has that name"),
        ({"parameters": {"p": Parameter("1", 1.0, tuple(range(20)))}}, "20 combinations"),
    ],
)
def test_a_declaration_that_lacks_something_is_refused(changes: dict[str, Any], complaint: str) -> None:
    whole = {"name": "mine", "force": ("-q * x", ""), "coefficients": {"q": Coefficient("1/s²")}}
    Declaration(**whole)
    with pytest.raises(ModelError) as error:
        Declaration(**(whole | changes))
    assert complaint in str(error.value)


def test_the_bounds_are_those_of_the_reference() -> None:
    assert (LONGEST, LARGEST_EXPONENT, len(FUNCTIONS)) == (500, 12, 7)


def test_equations_are_spaced_as_the_others_are() -> None:
    text = declared("-q  * x /  (2 - x / amplitude) ** 2").written()
    assert text == ("ẍ += -q*x/(2 - x/amplitude)**2",)
