"""Experiments that tell look-alikes apart: what they change in a bench file, and one made on an emulated board."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from estimator.trace.separation import EXPERIMENTS, Experiment
from hil.bench import Bench, load_bench, override
from hil.cli.trace import _announced
from hil.errors import InputError
from hil.examples import find
from hil.records.diagnosis import Confusable, Diagnosis
from hil.separate import changes, named, separable, separate
from tests.cli.diagnoses import explained


def alike(name: str | None, words: str = "in words that nothing hangs on") -> Diagnosis:
    """A diagnosis that cannot tell a sense gain from a drive gain, and proposes the experiment of that name."""
    pair = {
        "effect": "sense_gain", "with": "drive_gain", "correlation": 0.9996, "separate_by": words, "expected": 0.9,
        "experiment": name,
    }  # fmt: skip
    return explained(confusable=(Confusable.model_validate(pair),))


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


def test_only_what_an_experiment_would_tell_apart_is_tried() -> None:
    assert separable(alike(None)) == []
    assert separable(alike(None, "weigh the proof mass")) == []
    assert len(separable(alike(EXPERIMENTS[0].name))) == 1
    with pytest.raises(InputError, match="make it by hand"):
        named("wait for rain")


def test_what_an_experiment_did_not_tell_takes_all_of_them_and_then_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a bench on which nothing ever tells the pair apart: each step once, and an end."""
    bench = load_bench(find("bench", "s-slow"))
    name, words = EXPERIMENTS[0].name, EXPERIMENTS[0].words
    durations: list[float] = []

    def run_of(changed, link, out, *, note, progress):
        durations.append(changed.loop.duration_s / bench.loop.duration_s)
        return SimpleNamespace(folder=Path("run"))

    monkeypatch.setattr("hil.separate.run", run_of)
    monkeypatch.setattr("hil.separate.trace", lambda *given, **named: SimpleNamespace(diagnosis=alike(name)))
    told: list[str] = []
    made = separate(
        alike(name), bench, "inproc:none", Path("runs"), fraction=None, before_run=lambda _, words: told.append(words),
        progress=lambda _: None,
    )  # fmt: skip
    everything = EXPERIMENTS[-1].words
    longer = [f"{everything}, for {times} times as long" for times in (2, 4)]
    assert told == [words, everything, *longer] == [one.experiment for one in made]
    assert durations == [1.0, 1.0, 2.0, 4.0]
    assert all(one.still_alike and not one.apart for one in made)


@pytest.mark.slow
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
        fraction=None, before_run=lambda _, words: told.append(words), progress=lambda _: None,
    )  # fmt: skip
    assert told == [words] == [made.experiment]
    assert (made.run / "capture.arrow").exists()
    assert json.loads((made.run / "result.json").read_text(encoding="utf-8"))["operator_note"] == f"experiment: {words}"
    assert made.traced.diagnosis.verdict == "explained"
    assert [effect.name for effect in made.traced.diagnosis.effects] == ["sense_gain"]
    assert [pair.with_ for pair in made.apart] == ["drive_gain"]
    assert made.still_alike == ()


@pytest.mark.parametrize(("name", "turned"), [("amplitude", 0), ("rate", 1), ("all", 1)])
def test_who_is_at_the_bench_is_asked_to_turn_it(monkeypatch: pytest.MonkeyPatch, name: str, turned: int) -> None:
    asked: list[Bench] = []
    monkeypatch.setattr("hil.cli.consent.have_it_turned", asked.append)
    _announced(load_bench(find("bench", "s-slow")), named(name), "words")
    assert len(asked) == turned
