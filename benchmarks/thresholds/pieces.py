"""Records for a part of tracing alone, where a whole trace that comes to it would take minutes: of known size each, so
that an answer tells on which side of a threshold it lies.
"""

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.errors import ModelError
from estimator.settings import Device, ObserverSettings

if TYPE_CHECKING:
    from estimator.trace.problem import Problem

Answer = dict[str, Any]

_RATE, _CYCLE = 4000.0, 20
_OMEGA = 2.0 * math.pi * _RATE / _CYCLE
_DEVICE = Device(
    sample_rate=_RATE,
    stiffness=(_OMEGA**2, _OMEGA**2, 0.0),
    damping=(0.8, 0.8, 0.0),
    amplitude=1e-4,
    sense_gain=(890.0, 890.0),
    noise=(1e-4, 1e-4),
)


def pieces() -> dict[str, Callable[[], Answer]]:
    """By name, what the part answers."""
    return {
        "free, few cycles": _few_cycles,
        "a motion that ends": _ended,
        "long": _long,
        "lines in noise": _lines,
        "gains of the other sign": _gains,
        "a clock": _clock,
        "a climb beside a cliff": _cliff,
        "a climb to a level": _level,
        "a climb within a lobe": _lobe,
        "broad and narrow modes": _modes,
        "a line beside another": _beside,
        "a loss by chance": _loss,
        "openings": _openings,
        "modes that ring": _ringing,
        "a mode beside one frequency": _elsewhere,
    }


def _ring(samples: int, a_cycle: float = _CYCLE) -> "Problem":
    """A motion that nothing drives, with noise."""
    from estimator.record import Record
    from estimator.trace.problem import Problem

    rate = _RATE * a_cycle / _CYCLE
    t = np.arange(samples) / rate
    motion = 0.089 * np.exp(-0.4 * t)[:, None] * np.stack([np.cos(_OMEGA * t), np.sin(_OMEGA * t)], axis=1)
    motion += 1e-4 * np.random.default_rng(1).standard_normal((samples, 2))
    record = Record(motion, np.zeros((samples, 2, 1)), np.full(samples, 1.0 / rate))
    return Problem(record, _DEVICE, ObserverSettings())


def _few_cycles() -> Answer:
    """Six cycles and four."""
    from estimator.trace.fitness import require_traceable

    problem = _ring(1000, 100.0)
    try:
        require_traceable(problem.record, problem.device, 600)
    except ModelError as error:
        return {"verdict": f"refused: {str(error).partition(':')[0]}", "words": []}
    return {"verdict": "fit to be traced", "words": []}


def _ended() -> Answer:
    """At sample 470, twenty of which are a cycle."""
    from estimator.trace.rest import moves_until

    problem = _ring(4000)
    sense = problem.record.sense.copy()
    sense[470:] = 1e-4 * np.random.default_rng(2).standard_normal(sense[470:].shape)
    return {"verdict": f"moves up to sample {moves_until(replace(problem.record, sense=sense), _DEVICE)}", "words": []}


def _long() -> Answer:
    """So long that not every state is kept."""
    from estimator.trace.examination import examine

    found = examine(_ring(202_000), 120_000).estimates
    return {"verdict": f"states are kept every {found.index[1] - found.index[0]} samples", "words": []}


def _lines() -> Answer:
    """Of 0.7 and of 1.5 thousandths of the power far from a multiple, of 7 and of 15 beside the resonance."""
    from estimator.record import Record
    from estimator.trace.judgement import unexplained

    n = 60_000
    record = Record(np.zeros((n, 2)), np.zeros((n, 2, 1)), np.full(n, 1.0 / _RATE))
    white = np.random.default_rng(1).standard_normal((n, 2))
    told = []
    for frequency, thousandths in ((733.0, 0.7), (733.0, 1.5), (200.0, 7.0), (200.0, 15.0)):
        line = white.copy()
        line[:, 0] += np.sqrt(4e-3 * thousandths) * np.sin(2.0 * np.pi * frequency * np.arange(n) / _RATE)
        estimates = SimpleNamespace(innovation=line, innovation_deviation=np.ones((n, 2)))
        model: Any = SimpleNamespace(
            estimates=estimates, observer=SimpleNamespace(device=SimpleNamespace(noise=(1.0, 1.0)))
        )
        if any("line" in reason for reason in unexplained(model, record, 200.0)):
            told.append(f"{thousandths:g} ‰ at {frequency:g} Hz")
    return {"verdict": f"lines are left: {', '.join(told)}", "words": []}


def _gains() -> Answer:
    """Of −0.4, −0.7, −1.5 and −3 times the declared one."""
    from estimator.trace.engine import Estimate
    from estimator.trace.promises import turned

    sizes = (0.4, 0.7, 1.5, 3.0)
    gains = {size: Estimate(-1.0 - size, -1.01 - size, -0.99 - size) for size in sizes}
    told = [f"−{size:g}" for size, gain in gains.items() if turned("drive_gain", {"hx": gain})]
    return {"verdict": f"a polarity: {', '.join(told)}", "words": []}


def _clock() -> Answer:
    """Drives stronger by so many percent, where the stiffness is declared to 1 %."""
    from estimator.diagnosis import Interval
    from estimator.trace.symmetries import Constants, equivalents

    told = []
    for percent in (1, 2, 4, 7):
        gain = Interval(percent / 100.0, percent / 100.0 - 1e-5, percent / 100.0 + 1e-5, "")
        constants = Constants((1.0, 1.0, 0.0), (4e-3, 4e-3, 0.0), (1.0, 1.0, 0.0), 0.01)
        named = {"drive_gain": {"hx": gain, "hy": gain}}
        if any(one.other == "clock_rate" for one in equivalents(named, constants, None)):
            told.append(f"{percent} %")
    return {"verdict": f"may be a clock: drive gain of {', '.join(told)}", "words": []}


def _climbed(likelihood: Callable[[float], float], begin: float, width: float) -> tuple[float, float, int]:
    """Where a climb of one parameter ends, its deviation, and after how many models."""
    from estimator.trace.parameters import Hill

    asked: set[float] = set()

    class Closed(Hill):
        def __init__(self) -> None:
            self.seen = {}

        def at_each(self, places: Any) -> list[float]:
            asked.update(float(place[0]) for place in places)
            return [likelihood(float(place[0])) for place in places]

        def turned(self, place: Any) -> bool:
            return False

    top, deviation = Closed().climb(np.array([begin]), 0, width)
    return float(top[0]), deviation, len(asked)


def _cliff() -> Answer:
    """A likelihood with its top at 1, beyond 1.25 no model: begun at 0.9 with steps of 0.4."""
    top, deviation, models = _climbed(
        lambda place: -np.inf if place > 1.25 else -(((place - 1.0) / 0.02) ** 2), 0.9, 0.4
    )
    return {"verdict": f"top at {top:.3f} ± {deviation:.3f} after {models} models", "words": []}


def _level() -> Answer:
    """What a level that cuts the tops gains: most at 1, nothing from 0.1 % and 0.01 % above it on, where it cuts none;
    and where a top that no model beside it finds again is a jump.
    """

    def gain(edge: float) -> Callable[[float], float]:
        return lambda level: 1.5e4 * float(np.exp(-12.0 * abs(level - 1.0))) if level < edge else 0.0

    found = (
        _climbed(gain(1.001), 0.9995, 0.1),
        _climbed(gain(1.0001), 0.99995, 0.1),
        _climbed(lambda level: 40.0 * float(level == 1.0) - 20.0 * abs(level - 1.0), 1.0, 0.1),
    )
    told = ", ".join(f"{top:.4f} of {models}" for top, _, models in found)
    return {"verdict": f"levels {told} models", "words": []}


def _lobe() -> Answer:
    """A line's likelihood over its frequency, begun 4 rad over the record beside its top, within its first lobe."""
    from estimator.trace import parameters

    span = 1000.0 / _RATE
    asked: set[Any] = set()

    class Lobe(parameters.Hill):
        def __init__(self, *given: Any) -> None:
            self.seen, self.highest, self.best = {}, -np.inf, b""

        def at_each(self, places: Any) -> list[float]:
            asked.update(float(place[0]) for place in places)
            found = [1e4 * float(np.sinc((place[0] - 900.0) * span / 2.0 / np.pi)) ** 2 for place in places]
            self.highest = max(self.highest, *found)
            return found

        def turned(self, place: Any) -> bool:
            return False

        def moves(self, place: Any, deviation: Any) -> Any:
            return np.zeros((4, 1))

        def fitted(self, place: Any) -> Any:
            return SimpleNamespace(omega=float(place[0]), likelihood=self.highest)

    model: Any = SimpleNamespace(
        settings=ObserverSettings(effects={"interference": {"omega": 900.0 + 4.0 / span}}), likelihood=0.0
    )
    with in_place_of(parameters, "Hill", Lobe):
        top: Any = parameters.refine_parameters(_ring(1000), model, "interference")[0]
    return {"verdict": f"top at {top.omega:.2f} rad/s after {len(asked)} models", "words": []}


def _modes() -> Answer:
    """Of the damping ratios 0.00007, 0.00015, 0.2, 0.4 and 0.7, in responses from a third of the resonance to twice
    it, with noise of a millionth of the largest: of those that are seen, as what.
    """
    from estimator.trace.candidates import resonance

    told = []
    for zeta in (7e-5, 1.5e-4, 0.2, 0.4, 0.7):
        near = max(2e-3, min(zeta, 0.6))
        at = 1000.0 * np.linspace(1.0 - near, 1.0 + near, 401)
        random = np.random.default_rng(1).standard_normal((2, len(at)))
        response = 1e6 / (1e6 - at**2 + 2j * zeta * 1000.0 * at)
        response = response + 1e-6 * np.max(np.abs(response)) * (random[0] + 1j * random[1])
        if found := resonance(at, [response]):
            told.append(f"{found[1]:.2g}")
    return {"verdict": f"modes are seen: ζ {', '.join(told)}", "words": []}


def _beside() -> Answer:
    """10, 20, 45 and 80 rad over the record beside one that is carried."""
    from estimator.trace.look import fresh

    told = [
        f"{turn} rad" for turn in (10, 20, 45, 80)
        if fresh({"interference:1": {"omega": 900.0 + turn / 10.0}}, {"interference:2": {"omega": 900.0}}, span=10.0)
    ]  # fmt: skip
    return {"verdict": f"another line: {', '.join(told)} beside it", "words": []}


def _loss() -> Answer:
    """What taking an effect of two coefficients out loses of twice the log-likelihood: 23, 24.5, 26 and 28."""
    from estimator.trace import observer_model
    from estimator.trace.observer_model import Carrying, ObserverModel

    problem = _ring(1000).carrying({"drive_gain": {}})
    told = []
    for loss in (23.0, 24.5, 26.0, 28.0):
        innovation = np.zeros((1000, 2))
        kept: Any = SimpleNamespace(
            likelihood=loss, estimates=SimpleNamespace(innovation=innovation), observer=None, settings=problem.settings
        )
        less = SimpleNamespace(likelihood=0.0)
        with (
            in_place_of(observer_model, "fit", lambda *given, less=less, **more: less),
            in_place_of(observer_model, "coefficients_of", lambda observer: {"drive_gain": {}}),
        ):
            _, score = ObserverModel(problem).without(Carrying(problem, kept), "drive_gain")
        if score.gain > score.bar:
            told.append(f"{loss:g}")
    return {"verdict": f"kept at a loss of {', '.join(told)}", "words": []}


def _openings() -> Answer:
    """Of 15 000, 45 000 and 150 000 samples, those that a first pass sees."""
    from estimator.trace.fitting import _opening

    told = [f"{len(_opening(_ring(samples)).record)} of {samples}" for samples in (15_000, 45_000, 150_000)]
    return {"verdict": f"a first pass over {', '.join(told)}", "words": []}


def _ringing() -> Answer:
    """Modes at 0.4, 1.12, 1.5 and 2.85 of the resonance, of half the size each, that die away within a few cycles."""
    from estimator.trace.rings import rings

    t = np.arange(2000) / _RATE
    residual = 1e-3 * np.random.default_rng(5).standard_normal(len(t))
    for number, (order, zeta) in enumerate(((2.85, 0.02), (0.4, 0.03), (1.5, 0.01), (1.12, 0.01))):
        omega = order * _OMEGA
        residual += 0.5**number * np.exp(-zeta * omega * t) * np.cos(omega * t)
    found = rings([residual[:, None]], _RATE, _OMEGA)
    told = [f"{omega / _OMEGA:.2f} (ζ {0.5 * rate / omega:.3f})" for omega, rate in found]
    return {"verdict": f"rings at {', '.join(told)} of the resonance", "words": []}


def _elsewhere() -> Answer:
    """A drive of the resonance alone, whose residual is noise."""
    from estimator.trace.candidates import watch_list

    problem, random = _ring(4000), np.random.default_rng(6)
    t = np.arange(4000) / _RATE
    drive = np.stack([np.cos(_OMEGA * t), np.sin(_OMEGA * t)], axis=1)[:, :, None]
    record = replace(problem.record, drive=drive)
    watched = watch_list(record, _DEVICE, random.standard_normal((4000, 2)), np.ones((4000, 2)))
    given = [one for name, one in watched.items() if name.startswith("parasitic_mode")]
    told = [f"{one['omega'] / _OMEGA:.2f} of the resonance, ζ {one['zeta']:.3f}" for one in given]
    return {"verdict": f"a mode is watched at {'; '.join(told) or 'none'}", "words": []}


@contextlib.contextmanager
def in_place_of(module: Any, name: str, instead: Any) -> Iterator[None]:
    """The module with another in the place of one of its names."""
    own = getattr(module, name)
    setattr(module, name, instead)
    try:
        yield
    finally:
        setattr(module, name, own)
