"""Experiments that tell look-alikes apart: what they change in a bench file, and one made on an emulated board."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from estimator.trace.experiments import EXPERIMENTS, Experiment, Turn, turn_for
from hil.bench import Bench, load_bench, override
from hil.bench.examples import find
from hil.cli.show_diagnosis import print_diagnosis
from hil.cli.trace import _announced, _separated
from hil.errors import InputError
from hil.records.diagnosis import Diagnosis, Separation
from hil.running.request import RunRequest
from hil.tracing.separate import Asked, asked_for, changes, duration_for, named, separable, separate, within_reach
from tests.cli.diagnoses import explained


def pair(name: str | None, words: str | None = "in words that nothing hangs on", **more: Any) -> Separation:
    told = {
        "effect": "sense_gain", "with": "drive_gain", "correlation": 0.9996, "separate_by": words, "expected": 0.9,
        "experiment": name,
    }  # fmt: skip
    return Separation.model_validate(told | more)


def alike(name: str | None, words: str = "in words that nothing hangs on", **more: Any) -> Diagnosis:
    """A diagnosis that cannot tell a sense gain from a drive gain, and proposes the experiment of that name."""
    return explained(separations=(pair(name, words, **more),))


@pytest.fixture
def bench() -> Bench:
    return load_bench(find("bench", "s-slow"))


@pytest.fixture
def made(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What is made, and for how many durations, when each experiment is followed by these diagnoses, the last again and
    again.
    """

    def run(first: Diagnosis, *then: Diagnosis, of: Bench = bench) -> list[tuple[str, float]]:
        benches: list[Bench] = []
        asked: list[Asked] = []

        def run_of(request: RunRequest, out: Path, *, progress: Any) -> Any:
            benches.append(request.bench)
            assert request.options["note"] == f"experiment: {asked[-1].words}"
            return SimpleNamespace(folder=Path("run"))

        def trace(*given: Any, **named: Any) -> Any:
            return SimpleNamespace(diagnosis=then[min(len(benches), len(then)) - 1])

        monkeypatch.setattr("hil.tracing.separate.run", run_of)
        monkeypatch.setattr("hil.tracing.separate.trace", trace)
        done = separate(
            first, of, "inproc:none", Path("runs"), options={}, before_run=asked.append, progress=lambda _: None
        )
        assert [one.experiment for one in done] == [one.words for one in asked]
        lasting = [one.loop.duration_s / of.loop.duration_s for one in benches]
        assert lasting == [one.times for one in asked]
        run.last = done  # type: ignore[attr-defined]
        return [(one.experiment.name, times) for one, times in zip(asked, lasting, strict=True)]

    return run


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda experiment: experiment.name)
def test_every_experiment_is_a_bench_file(experiment: Experiment) -> None:
    bench = load_bench(find("bench", "s-slow"))
    found = named(experiment.name)
    made = override(bench, changes(found, bench), "test")
    given = made.controller
    assert given.amplitude_modulation == max(found.modulation, bench.controller.amplitude_modulation)
    assert given.stiffness_step == found.stiffness
    assert given.dither_mps2 >= found.dither * 1e-4 * (2 * 3.14159 * 200) ** 2 * 0.999
    assert abs(given.virtual_rotation_rad_s) >= abs(bench.controller.virtual_rotation_rad_s)
    assert made.limits.energy_error >= (1 + given.amplitude_modulation) ** 2 - 1
    assert made.loop.name == f"s-slow-{found.name}"
    assert made.model_copy(update={"controller": None, "limits": None, "loop": None}) == bench.model_copy(
        update={"controller": None, "limits": None, "loop": None}
    )


def test_steps_come_as_fast_as_they_are_planned(bench: Bench) -> None:
    """Modulation and steps of the stiffness, in rad of the vibration; where the bench file does as much, it stays."""
    given = override(bench, changes(named("together"), bench), "test").controller
    assert given.modulation_Hz == pytest.approx(200.0 / 200.0, rel=1e-3)
    assert given.stiffness_step_Hz == pytest.approx(200.0 / 120.0, rel=1e-3)
    more = override(bench, {"controller": {"amplitude_modulation": 0.4, "modulation_Hz": 3.0}}, "test")
    given = override(more, changes(named("together"), more), "test").controller
    assert (given.amplitude_modulation, given.modulation_Hz) == (0.4, 3.0)


def test_only_what_an_experiment_would_tell_apart_is_tried(bench: Bench) -> None:
    assert separable(alike(None), bench) == []
    assert separable(alike(None, "weigh the proof mass"), bench) == []
    assert len(separable(alike("amplitude"), bench)) == 1
    with pytest.raises(InputError, match="make it by hand"):
        named("wait for rain")


@pytest.mark.parametrize(("times", "tried"), [(3.99, 1), (4.01, 0)])
def test_what_takes_longer_than_four_durations_is_said_and_not_made(bench: Bench, times: float, tried: int) -> None:
    far = alike("amplitude", takes_s=times * bench.loop.duration_s)
    assert len(separable(far, bench)) == tried
    (one,) = within_reach(far)
    assert duration_for(one) == pytest.approx(0.25 * times * bench.loop.duration_s)


def test_an_observer_to_which_the_rate_is_a_constant_has_nobody_turn_it(bench: Bench, made: Any) -> None:
    still = override(bench, {"observer": {"process_noise": {"rate_rad_s_per_rts": 0.0}}}, "test")
    assert separable(alike("rate"), still) == []
    assert {name for name, _ in made(alike("amplitude"), alike("amplitude"), of=still)} == {"amplitude", "together"}


def test_what_an_experiment_did_not_tell_takes_all_of_them_and_then_longer(made: Any) -> None:
    """On a bench on which nothing ever tells the pair apart: each step once, and an end."""
    steps = made(alike("amplitude"), alike("amplitude"))
    assert steps == [("amplitude", 1), ("together", 1), ("all", 1), ("all", 2), ("all", 4)]
    assert all(one.still_alike and not one.apart for one in made.last)


def test_what_was_told_apart_by_turning_stays_so(made: Any) -> None:
    """Whatever is proposed next, the gyro goes on turning."""
    assert made(alike("rate"), alike("dither"), explained()) == [("rate", 1), ("all", 1)]


@pytest.mark.parametrize(("takes", "times"), [(0.9, 1), (1.9, 2), (2.1, 4)])
def test_an_experiment_lasts_as_long_as_it_takes(bench: Bench, made: Any, takes: float, times: int) -> None:
    assert made(alike("dither", takes_s=takes * bench.loop.duration_s), explained()) == [("dither", times)]
    assert made.last[0].experiment.endswith("s" if times > 1 else "resonance")


def test_no_experiment_is_shorter_than_the_one_before(bench: Bench, made: Any) -> None:
    long, short = (alike("dither", takes_s=takes * bench.loop.duration_s) for takes in (3.0, 0.5))
    assert made(long, short) == [("dither", 4), ("together", 1), ("all", 1), ("all", 2), ("all", 4)]
    assert made(alike("all", takes_s=3.0 * bench.loop.duration_s), alike("all")) == [("all", 4)]


def test_a_record_that_is_refused_is_kept_and_the_amplitude_left_alone(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A modulated amplitude may be more than the converter has room for: what was known before is not lost."""
    modulated: list[float] = []

    def run_of(request: RunRequest, *given: Any, **named: Any) -> Any:
        modulated.append(request.bench.controller.amplitude_modulation)
        return SimpleNamespace(folder=Path("run"))

    def trace(*given: Any, **named: Any) -> Any:
        if modulated[-1] > 0.0:
            raise InputError("capture.arrow: the board flagged 1% of the samples as clipped")
        return SimpleNamespace(folder=Path("trace"), diagnosis=alike("amplitude"))

    monkeypatch.setattr("hil.tracing.separate.run", run_of)
    monkeypatch.setattr("hil.tracing.separate.trace", trace)
    monkeypatch.setattr("hil.cli.consent.have_it_turned", lambda turn: None)
    traced: Any = SimpleNamespace(diagnosis=alike("amplitude"))
    last = _separated(traced, bench, "inproc:none", Path("runs"), {})
    assert modulated == [0.3, 0.0, 0.0, 0.0, 0.0]
    assert last is not traced
    said = capsys.readouterr()
    assert "cannot be traced: capture.arrow: the board flagged 1% of the samples as clipped" in said.out + said.err
    assert "experiment: dither and step the target stiffness" in said.out + said.err


def test_a_turn_is_planned_with_what_the_bench_file_lets_the_rate_wander(bench: Bench) -> None:
    asked = asked_for(named("rate"), 2, bench)
    omega0 = bench.target_stiffness_per_s2**0.5
    assert asked.turn == turn_for(omega0, 1.0, bench.loop.duration_s)
    assert asked.words == f"turn the gyro at a varying rate: {asked.turn.text}; for {2 * bench.loop.duration_s:g} s"


@pytest.mark.long
def test_the_experiment_is_made_on_the_board_and_decides(tmp_path: Path) -> None:
    changed = {"loop": {"clock": "lockstep", "duration_s": 8.0, "settle_s": 4.0}}
    bench = override(load_bench(find("bench", "s-slow")), changed, "test")
    scenario = tmp_path / "hidden.scenario.toml"
    before, _, _ = find("scenario", "s-slow").read_text(encoding="utf-8").partition("[rate]")
    hidden = '[rate]\nkind = "constant"\nrate_rad_s = 1.0\n\n[[effect]]\nname = "sense_gain"\ngx = 0.0\ngy = 0.01\n'
    scenario.write_text(before + hidden, encoding="utf-8")
    told: list[str] = []
    words = next(experiment.words for experiment in EXPERIMENTS if experiment.name == "amplitude")
    (made,) = separate(
        alike("amplitude"), bench, f"inproc:{scenario}", tmp_path / "runs",
        options={}, before_run=lambda asked: told.append(asked.words), progress=lambda _: None,
    )  # fmt: skip
    assert told == [words] == [made.experiment]
    assert (made.run / "capture.arrow").exists()
    assert json.loads((made.run / "result.json").read_text(encoding="utf-8"))["operator_note"] == f"experiment: {words}"
    assert made.traced.diagnosis.verdict == "explained"
    assert [effect.name for effect in made.traced.diagnosis.effects] == ["sense_gain"]
    assert [pair.with_ for pair in made.apart] == ["drive_gain"]
    assert made.still_alike == ()


@pytest.mark.parametrize(("name", "turned"), [("amplitude", 0), ("rate", 1), ("all", 1)])
def test_who_is_at_the_bench_is_asked_to_turn_it(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, name: str, turned: int
) -> None:
    turns: list[Turn] = []
    monkeypatch.setattr("hil.cli.consent.have_it_turned", turns.append)
    asked = asked_for(named(name), 1, bench)
    _announced(asked)
    assert turns == [asked.turn] * turned


def test_what_tells_a_pair_apart_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    """In the terminal: the group, how long the experiment has to last, or that nothing does."""
    pairs = (
        pair("amplitude", "modulate the amplitude", takes_s=31.4),
        pair(None, None),
    )
    print_diagnosis(explained(separations=pairs, ambiguity_groups=(("sense_gain", "drive_gain"),)))
    out = " ".join(capsys.readouterr().out.split())
    assert "to separate them: modulate the amplitude, for 31 s at least" in out
    assert out.count("no experiment separates them") == 1
    assert "ambiguity group of this record: sense_gain, drive_gain" in out


def test_it_says_how_long_a_run_would_be_enough(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("hil.tracing.separate.run", lambda *given, **named: pytest.fail("nothing is to be armed"))
    takes = 10.0 * bench.loop.duration_s
    traced: Any = SimpleNamespace(diagnosis=alike("amplitude", "modulate the amplitude", takes_s=takes))
    assert _separated(traced, bench, "inproc:none", Path("runs"), {}) is traced
    said = " ".join("".join(capsys.readouterr()).split())
    assert "no experiment to make" in said
    assert (
        f"takes {takes:.2g} s: modulate the amplitude; for that, give [loop] duration_s = {takes / 4:.2g} or more"
        in said
    )
