"""What a record was checked for: found, limit, kept."""

from typing import NamedTuple

from hil.numbers import count, percent, share, significant
from hil.report.markup import table
from hil.report.sensor.material import SensorMaterial
from hil.sensors.record import BENIGN, DAMAGED, LOST


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
    places = "" if not material.gaps else f" in {count(material.gaps)} gap" + ("s" if material.gaps > 1 else "")
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
    """The checks as a table."""
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
