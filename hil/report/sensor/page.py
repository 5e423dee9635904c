"""Puts the page of a recorded rate sensor together and writes it."""

import math
from pathlib import Path
from typing import NamedTuple

from hil.numbers import count, counted, percent, plus_minus, prefix_for, quantity, share, significant
from hil.records.atomic import write_text
from hil.records.result import Channel
from hil.records.runfolder import RunFolder
from hil.report import markup
from hil.report.markup import Figures, table
from hil.report.sensor import words
from hil.report.sensor.material import SensorMaterial
from hil.report.sensor.panels import allan_figure, rate_density_figure, sensor_rate_figure
from hil.report.sensor.words import NAMES, PER_HOUR, interval
from hil.report.tables import provenance
from hil.report.verdict import Headline, facts, headline
from hil.sensors.record import BENIGN, DAMAGED, LOST


def write_report(run: Path) -> Path:
    """Write `run/report.html`, whole or not at all, and return its path.

    Raises InputError for a folder that is not of a recorded sensor.
    """
    folder = RunFolder.open(run)
    write_text(folder.report_path, render(SensorMaterial(folder)))
    return folder.report_path


def render(material: SensorMaterial) -> str:
    figures = Figures()
    result = material.result
    remarks = "".join(markup.paragraph(markup.sentence(remark)) for remark in (*result.reasons, *result.remarks))
    sections = [
        markup.section(
            "recorded", "What was recorded", markup.paragraph(words.recorded(material)), axes_table(material)
        ),
        markup.section("checks", "Checks", remarks, checks_table(material)),
        markup.section(
            "rate", "Rate", markup.paragraph(words.moved(material)), figures.add(lambda: sensor_rate_figure(material))
        ),
        markup.section(
            "noise",
            "Noise",
            *(markup.paragraph(said) for said in words.noise(material)),
            figures.add(lambda: allan_figure(material)),
            noise_table(material),
            markup.paragraph(words.METHOD + _missing(material)),
            figures.add(lambda: rate_density_figure(material)),
        ),
        markup.section("run", "Record", provenance(material.run)),
    ]
    line = _headline(material)
    return markup.page(
        kind="Gyro bench · record of a rate sensor",
        title=result.run,
        line=line,
        key=markup.key_figures(_key_figures(material)),
        sections="".join(sections),
        facts=facts(result, {}),
    )


def _headline(material: SensorMaterial) -> Headline:
    result, sensor = material.result, material.sensor
    if result.verdict != "good":
        return headline(result)
    lost = "none lost" if not result.lost else f"{count(result.lost)} lost"
    damaged = result.counters.get("crc_errors", 0)
    wrong = "no wrong checksum" if not damaged else f"{count(damaged)} with a wrong checksum"
    samples = f"{count(result.samples)} samples of {count(len(sensor.channels))} axes"
    return Headline("good", "Good", f"{samples} in {words.length(result.seconds)}, {lost}, {wrong}")


def _key_figures(material: SensorMaterial) -> list[tuple[str, str, str]]:
    result, sensor = material.result, material.sensor
    apart = material.apart_ppm
    clock = "its own clock" if apart is None else f"{apart:+.0f} ppm by this machine's clock".replace("-", "−")
    entries = [
        ("Length", words.length(result.seconds), f"{count(result.samples)} samples"),
        ("Sample rate", quantity(sensor.sample_rate_Hz, "Hz"), clock),
        (
            "Lost, damaged",
            f"{count(result.lost)}, {count(result.counters.get('crc_errors', 0))}",
            "samples by the counter, datagrams by the checksum",
        ),
    ]
    white = {axis: found.readings["white"] for axis, found in material.noise.items() if "white" in found.readings}
    if white:
        axis = max(white, key=lambda name: white[name].value)
        value = f"{significant(white[axis].value * words.PER_ROOT_HOUR, 2)}\u00a0°/√h"
        entries.append(("Angle random walk", value, f"axis {axis}, the largest"))
    floors = {axis: found.bias_instability for axis, found in material.noise.items()}
    told = {axis: read for axis, read in floors.items() if read is not None}
    if told:
        axis = max(told, key=lambda name: told[name].value)
        value = f"{significant(told[axis].value * words.PER_HOUR, 2)}\u00a0°/h"
        entries.append(("Bias instability", value, f"axis {axis}, the largest that is determined"))
    elif any(found.bias_bound_rad_s is not None for found in material.noise.values()):
        bound = max(found.bias_bound_rad_s or 0.0 for found in material.noise.values()) * words.PER_HOUR
        entries.append(("Bias instability", "not shown", f"below {significant(bound, 2)}\u00a0°/h"))
    if sensor.latency_us is not None:
        remark = f"p50; p99.9 {significant(sensor.latency_us.p999)} µs, as the sensor says"
        entries.append(("Latency", f"{significant(sensor.latency_us.p50)} µs", remark))
    return entries


def _missing(material: SensorMaterial) -> str:
    if not material.capture.gaps:
        return ""
    return (
        " Samples are missing: a cluster's mean is over those there are, and clusters that lack more than a twentieth "
        "are left out."
    )


class Check(NamedTuple):
    """`kept` is None where there is no limit."""

    what: str
    found: str
    limit: str
    kept: bool | None


def checks(material: SensorMaterial) -> list[Check]:
    """Every check of the record, by the limits it was judged by."""
    result, sensor = material.result, material.sensor
    expected = result.samples + result.lost
    damaged = result.counters.get("crc_errors", 0)
    skipped = result.counters.get("skipped_bytes", 0)
    places = f" in {counted(material.capture.gaps, 'gap')}" if material.capture.gaps else ""
    found = [
        Check(
            "datagrams with a wrong checksum",
            share(damaged, expected),
            _at_most(DAMAGED),
            damaged <= DAMAGED * expected,
        ),
        Check("bytes that belong to no datagram", count(skipped), "", None),
        Check(
            "samples missing by the sensor's counter",
            share(result.lost, expected) + places,
            _at_most(LOST),
            result.lost <= LOST * expected,
        ),
    ]
    if not sensor.status:
        found.append(Check("status bits set", "none", "none", True))
    for complaint, samples in sensor.status.items():
        benign = complaint in BENIGN
        found.append(
            Check(
                f"status: {complaint}",
                f"in {share(samples, result.samples)} samples",
                "" if benign else "none",
                None if benign else False,
            )
        )
    if (latency := sensor.latency_us) is not None:
        interval_us = 1e6 / sensor.sample_rate_Hz
        found.append(
            Check(
                "latency, p50 · p99 · p99.9",
                " · ".join(significant(value) for value in (latency.p50, latency.p99, latency.p999)) + " µs",
                f"p99.9 at most a sample, {significant(interval_us)} µs",
                latency.p999 <= interval_us,
            )
        )
    found.append(Check("sample rate by this machine's clock", _rate(material), "", None))
    found.append(
        Check(
            "end of the record",
            "whole" if result.complete else "no end marker",
            "whole",
            result.complete and result.verdict != "interrupted",
        )
    )
    return found


def checks_table(material: SensorMaterial) -> str:
    rows = [(check.what, check.found, check.limit, _word(check.kept)) for check in checks(material)]
    return table("What the record was checked for", ("check", "found", "limit", "kept"), rows)


def _rate(material: SensorMaterial) -> str:
    nominal = f"nominal {material.sensor.sample_rate_Hz:.6g} Hz"
    if (measured := material.sensor.host_rate_Hz) is None or (apart := material.apart_ppm) is None:
        return f"not measured: needs a second of record; {nominal}"
    return f"{significant(measured, 7)} Hz; {nominal}, {'+' if apart >= 0 else '−'}{abs(apart):.0f} ppm"


def _at_most(limit: float) -> str:
    return f"at most {percent(limit)}"


def _word(kept: bool | None) -> str:
    return "" if kept is None else "yes" if kept else "no"


def axes_table(material: SensorMaterial) -> str:
    """Mean, spread, white noise and extremes of each axis."""
    spread = max((channel.sd_rad_s for channel in material.sensor.channels.values()), default=0.0)
    factor, prefix = prefix_for(math.degrees(spread))
    rows = []
    for axis, rate in material.rates_rad_s.items():
        channel = material.sensor.channels[axis]
        white = "–" if channel.noise_rad_s is None else significant(math.degrees(channel.noise_rad_s) * factor)
        rows.append(
            (
                axis,
                _mean(channel, rate.size),
                significant(math.degrees(channel.sd_rad_s) * factor),
                white,
                significant(math.degrees(float(rate.min())), 4),
                significant(math.degrees(float(rate.max())), 4),
            )
        )
    unit = f"({prefix}deg/s)"
    head = ("axis", "mean / (deg/s)", f"standard deviation / {unit}", f"white noise of a sample / {unit}")
    caption = "Each axis over the whole record; white noise by the differences of neighbouring samples"
    return table(caption, (*head, "least / (deg/s)", "most / (deg/s)"), rows, (1, 2, 3, 4, 5))


def _mean(channel: Channel, samples: int) -> str:
    """In deg/s, to the digits that white noise of its spread leaves it."""
    mean, sd = math.degrees(channel.mean_rad_s), math.degrees(channel.sd_rad_s)
    return plus_minus(mean, 2.0 * sd / math.sqrt(samples), beside=mean)


def noise_table(material: SensorMaterial) -> str:
    """What the Allan deviation of each axis shows."""
    rows = []
    for axis, found in material.noise.items():
        for term, read in found.readings.items():
            if term != "flicker":
                rows.append((axis, NAMES[term][0], interval(read, term), f"{significant(read.tau_s)} s"))
        if found.bias_instability is not None:
            read = found.bias_instability
            rows.append((axis, "bias instability", interval(read, "flicker"), f"{significant(read.tau_s)} s"))
        elif found.bias_bound_rad_s is not None:
            bound = f"not shown; below {significant(found.bias_bound_rad_s * PER_HOUR, 2)}\u00a0°/h"
            rows.append((axis, "bias instability", bound, f"{significant(found.lowest_s or 0.0)} s"))
    head = ("axis", "noise", "value, 95 % interval", "read at τ")
    return table("Noise, as far as the record tells", head, rows, (3,)) if rows else ""
