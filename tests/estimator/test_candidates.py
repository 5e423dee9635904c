"""What is looked for on a record: modes from the drive's response, labels that stay apart, second thoughts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from estimator.effects.catalogue import EFFECTS
from estimator.effects.search import Search
from estimator.record import Record
from estimator.trace import free_run_model
from estimator.trace.candidates import kind, resonance, searched_by, watch_list
from estimator.trace.evidence import Evidence
from estimator.trace.look import fresh
from estimator.trace.width import second_thoughts
from tests.estimator.test_scan import DEVICE, OMEGA0, SETTINGS, record

ONE_AXIS = replace(
    DEVICE, stiffness=DEVICE.stiffness[:1], damping=DEVICE.damping[:1], sense_gain=(-890.0,), noise=(9e-5,)
)


def mode(omega: float, zeta: float, at: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 / (omega**2 - at**2 + 2j * zeta * omega * at))


@pytest.mark.parametrize(("omega", "zeta"), [(1000.0, 2e-2), (1030.0, 1e-3), (960.0, 8e-3)])
def test_the_response_to_the_drive_tells_a_mode(omega: float, zeta: float) -> None:
    at = np.arange(900.0, 1101.0, 12.5)
    responses = [size * mode(omega, zeta, at) for size in (3.0, -0.7)]
    noise = np.random.default_rng(1).standard_normal((2, 2, len(at))) * 2e-3 * np.max(np.abs(responses))
    seen = resonance(at, [r + n[0] + 1j * n[1] for r, n in zip(responses, noise, strict=True)])
    assert seen is not None
    assert seen[0] == pytest.approx(omega, rel=2e-3)
    assert seen[1] == pytest.approx(zeta, rel=0.2, abs=5e-4)


@pytest.mark.moderate
@pytest.mark.parametrize(("at", "is_watched"), [(1.8, True), (0.6, True), (1.0, False), (1.004, False)])
def test_what_follows_the_drive_at_the_resonance_is_the_gyro_and_no_other_mode(at: float, *, is_watched: bool) -> None:
    rng = np.random.default_rng(4)
    n, rate = 60_000, DEVICE.sample_rate
    drive = rng.standard_normal((n, 2))
    omega, zeta = at * OMEGA0, 2e-3
    mode = cont2discrete(([1.0], [1.0, 2.0 * zeta * omega, omega**2]), 1.0 / rate)
    innovation = lfilter(mode[0].ravel(), mode[1], drive, axis=0) * omega**2 + rng.standard_normal((n, 2))
    excited = Record(np.zeros((n, 2)), drive[:, :, None], np.full(n, 1.0 / rate))
    watched = watch_list(excited, DEVICE, innovation, np.ones_like(innovation))
    modes = [given["omega"] for name, given in watched.items() if kind(name) == "parasitic_mode"]
    assert any(abs(one / omega - 1.0) < 0.01 for one in modes) is is_watched


@pytest.mark.moderate
def test_a_mode_that_rings_for_longer_than_a_segment_is_seen_beside_what_follows_the_drive_at_once() -> None:
    """It follows the drive of segments before, so that there is less coherence at its peak than anywhere else."""
    rng = np.random.default_rng(6)
    n, rate, omega, zeta = 60_000, DEVICE.sample_rate, 1.8 * OMEGA0, 1e-4
    drive = rng.standard_normal((n, 2))
    mode = cont2discrete(([1.0], [1.0, 2.0 * zeta * omega, omega**2]), 1.0 / rate)
    ringing = lfilter(mode[0].ravel(), mode[1], drive, axis=0) * omega**2
    innovation = 3.0 * drive + ringing + 0.1 * rng.standard_normal((n, 2))
    excited = Record(np.zeros((n, 2)), drive[:, :, None], np.full(n, 1.0 / rate))
    watched = watch_list(excited, DEVICE, innovation, np.ones_like(innovation))
    modes = [given["omega"] for name, given in watched.items() if kind(name) == "parasitic_mode"]
    assert any(abs(one / omega - 1.0) < 0.01 for one in modes)


@pytest.mark.moderate
def test_what_no_record_can_tell_is_never_a_candidate() -> None:
    hidden = {"clock_rate", "unequal_masses", "drive_polarity", "sense_polarity"}
    assert {effect.name for effect in EFFECTS if effect.declared_only} == hidden
    rng = np.random.default_rng(3)
    innovation = rng.standard_normal((len(record()), 2))
    watched = {kind(name) for name in watch_list(record(), DEVICE, innovation, np.ones_like(innovation))}
    assert not watched & hidden
    assert {"drive_gain", "sense_gain", "dry_friction"} <= watched
    for device in (DEVICE, ONE_AXIS):
        assert not set(free_run_model.candidates(device, SETTINGS)) & hidden


def test_a_flat_response_tells_none() -> None:
    at = np.arange(900.0, 1101.0, 12.5)
    random = np.random.default_rng(2)
    assert resonance(at, [1.0 + 0.01 * random.standard_normal(len(at)) + 0j]) is None


def test_a_line_at_another_frequency_gets_a_label_of_its_own() -> None:
    carried = {"interference:1": {"lcx": 1.0, "omega": 500.0}, "sense_gain": {"gy": 0.1}}
    watched = {
        "interference:1": {"omega": 700.0},
        "interference:2": {"omega": 500.1},
        "sense_gain": {},
        "drive_gain": {},
    }
    assert fresh(watched, carried, span=10.0) == {"interference:3": {"omega": 700.0}, "drive_gain": {}}


def test_second_thoughts_are_of_every_other_kind_once() -> None:
    def item(name: str, gain: float) -> Evidence:
        return Evidence(name, gain, 1, 1.0, np.zeros(1), np.ones(1))

    found = {name: item(name, 9.0) for name in ("drag", "interference:1", "interference:2", "dry_friction")}
    assert second_thoughts(found, {"drag"}) == ["interference:1", "dry_friction"]


def test_where_parameters_are_searched_for_is_said_of_those_of_the_catalogue_that_have_some() -> None:
    assert searched_by("dry_friction") is searched_by("dry_friction:2") is Search.SPEEDS
    assert searched_by("cubic_stiffness") is None
    assert searched_by("an_effect_of_my_own") is None
