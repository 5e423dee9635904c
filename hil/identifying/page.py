"""The page of an identification: constants with intervals, Bode and ring-down plots, what is proposed."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.identify.fit import innovations
from estimator.identify.model import Predictor, physical
from estimator.spans import spans
from hil.identifying.bench_file import text_of
from hil.identifying.findings import CALLED, Findings
from hil.identifying.recording import Sampled
from hil.identifying.request import IdentifyRequest
from hil.numbers import counted, plus_minus, significant
from hil.records.atomic import write_text
from hil.report import markup
from hil.report.markup import Figures
from hil.report.theme import AXIS_COLOURS, INK, Drawing, legend, new_figure, plain_log_ticks
from hil.report.verdict import Headline

_BINS = 240
_SHOWN = 1500  # points of a curve


def write_page(place: Path, found: Findings, records: Sequence[Sampled], request: IdentifyRequest) -> None:
    """Whole or not at all."""
    write_text(place, page(found, records, request))


def page(found: Findings, records: Sequence[Sampled], request: IdentifyRequest) -> str:
    """As text."""
    figures, record = Figures(), records[-1]
    good = not found.faults
    told = (*(found.faults or ("the board does what it says",)), *found.remarks)
    sentence, *more = (line[:1].upper() + line[1:] for line in told)
    sections = [
        markup.section("told", "What was found", *(markup.paragraph(f"{line}.") for line in more), _table(found)),
        markup.section("bode", "Response", figures.add(lambda: _bode(found, records))),
        markup.section("ring-down", "Ring-down", figures.add(lambda: _ring_down(found, record))),
        markup.section("residual", "Residual", figures.add(lambda: _residual(found, record))),
        markup.section("proposed", "Proposed settings", _predicted(found), _proposed(found)),
        markup.section(
            "file", "Bench file", markup.listing(text_of(found, request.name, request.mass_kg, request.kept_link))
        ),
    ]
    board = found.identity
    return markup.page(
        kind="Gyro bench · identification",
        title=request.name,
        line=Headline("good" if good else "bad", "Good" if good else "Refused", sentence),
        key=markup.key_figures(_key(found)),
        sections="".join(sections),
        facts=(f"board {board.unique_id:016x}", f"firmware {board.version}", counted(found.rows, "sample")),
    )


def _key(found: Findings) -> list[tuple[str, str, str]]:
    def with_u(name: str, unit: str, factor: float = 1.0) -> tuple[str, str]:
        one = found.constants[name]
        value, _, wide = plus_minus(factor * one.value, 2.0 * factor * one.u).partition(" ± ")
        return f"{value}\u00a0{unit}", f"± {wide} (95 %)"

    return [
        ("Higher resonance", *with_u("resonance_1", "Hz")),
        ("Split", *with_u("split", "Hz")),
        ("Shorter decay time", *with_u("decay_time_1", "s")),
        ("Latency", counted(found.latency_ticks, "tick"), f"IDENTITY says {found.identity.latency_ticks}"),
    ]


def _table(found: Findings) -> str:
    rows = [
        (CALLED[name], plus_minus(one.value, 2.0 * one.u), "" if one.unit == "1" else one.unit)
        for name, one in found.constants.items()
    ]
    rows += [
        (f"sense noise {axis}, rms", significant(float(v), 4), "V") for axis, v in zip("xy", found.noise_V, strict=True)
    ]
    rows.append(("force noise", significant(found.force_mps2_per_rtHz, 2), "m/s²/√Hz"))
    untold = markup.paragraph(
        "Gains are products of drive and sense: the drive's scale is the board's word. A known force or a known "
        "displacement tells them apart. Mass, angular gain and the error of the clock are not in a record."
    )
    return markup.table("Constants per unit mass", ("constant", "value ± (95 %)", "unit"), rows, (1,)) + untold


def _predicted(found: Findings) -> str:
    if found.advice is None:
        return ""
    return markup.paragraph("What they will reach on this board, by its model:") + "".join(
        markup.paragraph(line) for line in (*found.advice.sentences, *found.advice.missed)
    )


def _proposed(found: Findings) -> str:
    rows = [
        (f"[{section}] {key}", significant(value, 4) if isinstance(value, float) else str(value))
        for section, table in found.settings.items()
        for key, value in table.items()
    ]
    return markup.table("Of the bench file", ("key", "value"), rows, (1,))


def response(found: Findings, hertz: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Volts per m/s² (m, 2, 2): channel, drive; held over the interval that ends at its row, and delayed."""
    rate, theta = found.identity.tick_rate_Hz, found.fitted.theta
    of, s = physical(theta), 2j * np.pi * hertz / rate
    dynamic = s[:, None, None] ** 2 * np.eye(2) + s[:, None, None] * of.damping + of.stiffness
    held = (np.exp(s) - 1.0) / s * np.exp(-s * theta[11])
    return np.asarray(np.linalg.solve(dynamic, np.broadcast_to(of.gain, dynamic.shape)) * held[:, None, None])


def _bode(found: Findings, records: Sequence[Sampled]) -> Drawing | None:
    rate = found.identity.tick_rate_Hz
    middle = found.omega / (2.0 * np.pi)
    hertz = np.geomspace(middle / 8.0, min(middle * 6.0, 0.45 * rate), _SHOWN)
    near = middle * (1.0 + np.linspace(-0.05, 0.05, _SHOWN))
    hertz = np.sort(np.concatenate([hertz, near]))
    model = response(found, hertz)
    figure = new_figure(3.6)
    size, phase = figure.subplots(2, 1, sharex=True)
    for axis, colour in enumerate(AXIS_COLOURS):
        own = model[:, axis, axis]
        size.loglog(hertz, np.abs(own), color=colour, linewidth=1.0, label=f"{'xy'[axis]} by the drive of {'xy'[axis]}")
        phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(own))), color=colour, linewidth=1.0)
        for record in records:
            seen = _empirical(record, axis, hertz[0], hertz[-1])
            if seen is not None:
                size.loglog(seen[0], np.abs(seen[1]), ".", color=colour, markersize=2.5)
                model_there = response(found, seen[0])[:, axis, axis]
                turned = np.angle(seen[1] / model_there) + np.interp(seen[0], hertz, np.unwrap(np.angle(own)))
                phase.semilogx(seen[0], np.degrees(turned), ".", color=colour, markersize=2.5)
    size.loglog(hertz, np.abs(model[:, 1, 0]), color=INK, linewidth=0.7, dashes=(3, 2), label="y by the drive of x")
    size.set_ylabel("V per m/s²")
    phase.set_ylabel("phase / °")
    phase.set_xlabel("frequency / Hz")
    plain_log_ticks(phase.xaxis)
    legend(size)
    caption = "Lines: the fitted device with its hold and delay. Points: spectra of sense over drive, averaged in bins."
    return Drawing(figure, "Response of sense to drive", caption, f"Bode plot around {middle:.6g} hertz. {caption}")


def _empirical(
    record: Sampled, axis: int, low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.complex128]] | None:
    """Cross over power spectrum of one axis, in bins of even ratio, where the other axis' drive is small."""
    sense, drive = np.nan_to_num(record.sense - np.nanmean(record.sense, axis=0)), np.nan_to_num(record.drive)
    hertz = np.fft.rfftfreq(len(sense), 1.0 / record.rate)
    voltage, force = np.fft.rfft(sense[:, axis]), np.fft.rfft(drive[:, axis])
    other = np.fft.rfft(drive[:, 1 - axis])
    power = np.abs(force) ** 2
    used = (hertz > low) & (hertz < high) & (power > 1e-4 * power.max()) & (power > 4.0 * np.abs(other) ** 2)
    if np.sum(used) < 10:
        return None
    bins = np.digitize(hertz[used], np.geomspace(low, high, _BINS))
    cross, weight = (voltage * np.conj(force))[used], power[used]
    total = np.bincount(bins, weight)
    there = total > 0.0
    mean = (np.bincount(bins, cross.real) + 1j * np.bincount(bins, cross.imag)).astype(np.complex128)
    mean = mean[there] / total[there]
    return np.bincount(bins, hertz[used] * weight)[there] / total[there], mean


def _ring_down(found: Findings, record: Sampled) -> Drawing | None:
    quiet = ~np.nan_to_num(record.drive).any(axis=1)
    stretches = spans(quiet)
    if not stretches:
        return None
    begin, end = max(stretches, key=lambda one: one[1] - one[0])
    sense = record.sense[begin:end] - [found.value("offset_x"), found.value("offset_y")]
    cycle = max(round(2.0 * np.pi * record.rate / found.omega), 1)
    stride = max(len(sense) // (cycle * _SHOWN), 1) * cycle
    count = len(sense) // stride
    if count < 8 or not np.isfinite(sense).any():
        return None
    level = np.sqrt(2.0 * np.nanmean(np.square(sense[: count * stride].reshape(count, stride, 2)), axis=1))
    seconds = (np.arange(count) + 0.5) * stride / record.rate
    figure = new_figure(2.4)
    ax = figure.subplots()
    for axis, colour in enumerate(AXIS_COLOURS):
        ax.semilogy(seconds, level[:, axis], color=colour, linewidth=1.0, label=f"sense {'xy'[axis]}")
    both = np.sqrt(np.sum(level**2, axis=1))
    decay = 4.0 / (found.value("dxx") + found.value("dyy"))
    ax.semilogy(seconds, both[0] * np.exp(-seconds / decay), color=INK, linewidth=0.7, label="mean damping")
    ax.set_xlabel("time / s")
    ax.set_ylabel("amplitude / V")
    plain_log_ticks(ax.yaxis)
    legend(ax)
    caption = "Amplitude of each channel in the longest free decay; two resonances beat where they share a channel."
    return Drawing(figure, "Ring-down", caption, f"Amplitude over {seconds[-1]:.3g} seconds. {caption}")


def _residual(found: Findings, record: Sampled) -> Drawing | None:
    parts = record.parts
    if not parts:
        return None
    left = innovations(Predictor(found.fitted.theta), parts, found.noise_V).left[0]
    every = max(len(left) // _SHOWN, 1)
    count = len(left) // every
    rms = np.sqrt(np.mean(np.square(left[: count * every].reshape(count, every, 2)), axis=1))
    figure = new_figure(2.2)
    ax = figure.subplots()
    seconds = (np.arange(count) + 0.5) * every / record.rate
    for axis, colour in enumerate(AXIS_COLOURS):
        ax.plot(seconds, rms[:, axis], color=colour, linewidth=0.8, label=f"{'xy'[axis]}")
    ax.set_xlabel("time / s")
    ax.set_ylabel("rms / noise")
    ax.set_ylim(0.0, max(2.0, 1.2 * float(np.nanmax(rms))))
    legend(ax)
    caption = "What the fitted device leaves of the samples, over the noise: 1 all along where nothing is lacking."
    return Drawing(figure, "Residual", caption, f"From {np.nanmin(rms):.2f} to {np.nanmax(rms):.2f}. {caption}")
