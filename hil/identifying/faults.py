"""What a board says of itself, or a file of it, that its record refutes: each in one line with the cure."""

from collections.abc import Iterator

import numpy as np

from estimator.identify.model import NAMES
from hil.bench import Bench
from hil.identifying.findings import Findings
from hil.identifying.recording import Sampled
from hil.wire.messages import Identity

_SURE = 6.0  # standard deviations
_TICK = 0.5  # samples of delay beyond which it is another tick
_SCALE = 0.25  # relative, beyond any tolerance of a data sheet
_FAST = 0.02  # relative, of a resonance
_CROSSED = 1.0  # share of a drive on the other axis: beyond it that one is its own
_FEW = 200  # codes that have to be there to tell how they step
_QUARTER = 0.12  # turns by which a response leads or lags where another quantity is sensed


def faults_of(found: Findings, declared: Bench | None) -> tuple[str, ...]:
    """All of them; the first explains most."""
    if crossed := list(_crossed(found)):
        return tuple(crossed)
    if dead := list(_dead(found)):
        return tuple(dead)
    return (*_delayed(found), *_signs(found, declared), *([] if declared is None else _scales(found, declared)))


def codes_of(record: Sampled, identity: Identity) -> tuple[str, ...]:
    """Converters whose codes do not step as IDENTITY says."""
    return tuple(_codes(record, identity))


def _codes(record: Sampled, identity: Identity) -> Iterator[str]:
    for what, values, scale, bits in (
        ("sense", record.sense, identity.sense_scale_V, identity.sense_bits),
        ("drive", record.drive, identity.drive_scale_mps2, identity.drive_bits),
    ):
        codes = np.rint(values[np.isfinite(values).all(axis=1)] / scale).astype(np.int64)
        for axis in range(2):
            there = np.unique(codes[:, axis])
            if len(there) and max(abs(int(there[0])), abs(int(there[-1]))) > 1 << (bits - 1):
                yield f"{what} {'xy'[axis]} shows codes beyond {bits} bits; correct IDENTITY.{what}_bits"
            step = int(np.gcd.reduce(np.abs(there - there[0]))) if len(there) > _FEW else 1
            if step > 1:
                yield (
                    f"codes of {what} {'xy'[axis]} are all multiples of {step}: the converter has "
                    f"{np.log2(step):.0f} bits less, or IDENTITY.{what}_scale is of another code; correct {what}_bits "
                    f"and {what}_scale"
                )


def _dead(found: Findings) -> Iterator[str]:
    for axis in "xy":
        if abs(found.value(f"gain_{axis}")) < _SURE * found.u(f"gain_{axis}"):
            yield f"the drive of {axis} moves nothing that sense {axis} shows; check its amplifier, bias and wiring"


def _crossed(found: Findings) -> Iterator[str]:
    """By the gains of the other axes, which a record tells well even where those of its own are next to nothing."""
    theta, covariance = found.fitted.theta, found.fitted.covariance
    pairs = [[NAMES.index(name) for name in names] for names in (("gain_x", "share_xy"), ("gain_y", "share_yx"))]
    for gain, share in pairs:
        slope = theta[[share, gain]]
        u = float(np.sqrt(slope @ covariance[np.ix_([gain, share], [gain, share])] @ slope))
        if abs(theta[share]) <= _CROSSED or abs(theta[gain] * theta[share]) < _SURE * u:
            return
    yield "the drive of x moves sense y, and that of y sense x: exchange the channels of sense or drive"


def _delayed(found: Findings) -> Iterator[str]:
    delay, u, latency = found.value("delay"), found.u("delay"), found.identity.latency_ticks
    cycle = 2.0 * np.pi * found.identity.tick_rate_Hz / found.omega
    if abs(delay) - _SURE * u < _TICK:
        return
    turns = delay / cycle
    if abs(abs(turns) - 0.25) < _QUARTER and abs(delay - round(delay)) > 0.1:
        what = "velocity" if turns < 0.0 else "an integral of the displacement"
        yield f"the response is a quarter of a cycle off: {what} is sensed; set [device.sense] senses, or the wiring"
        return
    later = "later" if delay > 0.0 else "earlier"
    yield (
        f"the drive acts {abs(delay):.3f} ± {2.0 * u:.1g} ticks {later} than its row says: latency is "
        f"{found.latency_ticks} ticks, IDENTITY says {latency}; correct latency_ticks, or when the converters act"
    )


def _signs(found: Findings, declared: Bench | None) -> Iterator[str]:
    signs = [float(np.sign(found.value(f"gain_{axis}"))) for axis in "xy"]
    if declared is not None:
        expected = [float(np.sign(gain)) for gain in declared.device.sense_gains_V_per_m]
        wrong = [axis for axis, sign, right in zip("xy", signs, expected, strict=True) if sign != right]
        if wrong:
            yield (
                f"the drive of {' and '.join(wrong)} acts the wrong way round: its response has the other sign than "
                "[device.sense] gain_V_per_m; check the wiring of drive and sense"
            )
    elif signs[0] != signs[1]:
        odd = "xy"[signs.index(min(signs))]
        yield (
            f"x and y respond with unlike signs (that of {odd} is negative): one channel has the wrong sign; "
            "correct the wiring, or declare both gains with --like"
        )


def _scales(found: Findings, declared: Bench) -> Iterator[str]:
    for axis, gain in zip("xy", declared.device.sense_gains_V_per_m, strict=True):
        ratio = abs(found.value(f"gain_{axis}") / gain)
        if abs(np.log(ratio)) > np.log(1.0 + _SCALE):
            yield (
                f"drive and sense of {axis} together have {ratio:.4g} × the declared gain: sense_scale_V or "
                "drive_scale_mps2 of IDENTITY is wrong, or gain_V_per_m; a known force or displacement tells which"
            )
    hertz = found.omega / (2.0 * np.pi)
    if abs(np.log(hertz / declared.device.resonance_Hz)) > _FAST + float(declared.observer.initial_sd.stiffness):
        yield (
            f"it resonates at {hertz:.6g} Hz, {declared.device.resonance_Hz:.6g} Hz are declared: "
            "IDENTITY.tick_rate_Hz is wrong by that ratio, or the declaration"
        )
    for axis in "xy":
        offset = found.value(f"offset_{axis}")
        if abs(offset) > _SURE * declared.offset_sd_V + _SURE * found.u(f"offset_{axis}"):
            yield f"sense {axis} sits at {offset:.3g} V, [device.sense] offset_sd_V is {declared.offset_sd_V:.3g} V"
