"""Reports as they are read: on a phone, on a wide screen, in the dark, on paper. Nothing may be cut."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest
from playwright.sync_api import Browser

from estimator import diagnosis as traced
from hil.records.diagnosis import to_model
from hil.records.result import Parameter, load_result, save_result
from hil.report.page import write_report
from hil.scoring.score import score
from tests.browser.axe import violations
from tests.made_once import made_once
from tests.records.synthetic_run import Options, write_run
from tests.records.test_diagnosis import answer, written

pytestmark = pytest.mark.slow

_A4_PX = 673  # 210 mm less margins of 16 mm, of 25.4/96 mm each

_CUT = """() => {
  const width = document.documentElement.clientWidth;
  const scrolls = (one) => { for (; one; one = one.parentElement)
    if (["auto", "scroll"].includes(getComputedStyle(one).overflowX)) return true; return false; };
  return [...document.querySelectorAll("table, figure, svg, pre, dd, .equation")].filter((one) =>
    one.checkVisibility() && Math.max(one.getBoundingClientRect().right, one.getBoundingClientRect().left
      + one.scrollWidth) > width + 0.5 && !scrolls(one)).map((one) => one.outerHTML.slice(0, 160));
}"""
"""What reaches beyond the page and cannot be scrolled to."""


def several() -> traced.Diagnosis:
    """Two effects with long titles and long numbers: the widest table there is."""
    known = answer()
    (cubic,) = known.effects
    damping = {f"dc{axis}": traced.Interval(-3.5389e-4, -3.9e-4, -3.1e-4, "s/m²") for axis in "xy"}
    other = replace(
        cubic, name="nonlinear_damping", title="Nonlinear damping of each axis", coefficients=damping,
        equation=("ẍ = … -dcx*vx**3 -dqx*vx**2*tanh(100.0*vx) -dcx*vx**3 -dqx*vx**2*tanh(100.0*vx)",),
    )  # fmt: skip
    sharp = {
        "k3x": traced.Interval(1.000211e13, 1.000209e13, 1.000213e13, "1/(m²·s²)"),
        "k3y": cubic.coefficients["k3y"],
    }
    return replace(known, effects=(replace(cubic, coefficients=sharp), other))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The report of a run that carries what a trace found, beside the run before it, and that of a trace."""

    def make(place: Path) -> None:
        folder, before = place / "20250314-092653-bench", place / "20250314-092000-before"
        truth, earlier = write_run(folder, Options()), write_run(before, Options(angle_drift=0.3))
        score(before, earlier)
        result = score(folder, truth)
        effects = {
            symbol: Parameter(value=one.value, ci95=(one.low, one.high), unit=one.unit, truth=1.01 * one.value)
            for effect in several().effects
            for symbol, one in effect.coefficients.items()
            if symbol != "k3y"
        }
        told = {
            "diagnosis": to_model(several(), record="ride", bench="S-test").model_dump(mode="json", by_alias=True),
            "parameters": result.parameters | effects,
        }
        save_result(folder / "result.json", load_result(folder / "result.json").model_copy(update=told))
        write_report(folder, truth, earlier=(before, earlier))
        (place / "trace").mkdir()
        written(place / "trace", several())

    made = made_once(tmp_path_factory, "reports", make)
    return {"run": made / "20250314-092653-bench" / "report.html", "trace": made / "trace" / "report.html"}


@pytest.fixture(params=["run", "trace"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=["phone", "wide", "dark", "print"])
def shown(request: pytest.FixtureRequest, browser: Browser, name: str, pages: dict[str, Path]) -> Iterator[Any]:
    """The page in that medium, and what the medium is called."""
    width = {"phone": 420, "print": _A4_PX}.get(request.param, 1400)
    scheme: Literal["light", "dark"] = "dark" if request.param == "dark" else "light"
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page = context.new_page()
    page.goto(pages[name].as_uri())
    if request.param == "print":
        page.emulate_media(media="print")
    yield page, request.param
    context.close()


@pytest.mark.beyond(2)
def test_nothing_is_cut(shown: Any, name: str, pictures: Path) -> None:
    page, medium = shown
    page.screenshot(path=pictures / f"report-{name}-{medium}.png", full_page=True)
    wide, there = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    assert wide <= there
    assert page.evaluate(_CUT) == []
    if medium == "print":  # nobody scrolls on paper
        boxes = page.evaluate(
            "[...document.querySelectorAll('.wide, .plot, .equation')].map(one => [one.scrollWidth, one.clientWidth])"
        )
        assert boxes
        assert all(inside <= box for inside, box in boxes)
    else:
        assert violations(page) == []
