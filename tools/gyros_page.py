"""The page of the commercial gyros that are recognised, as they are declared."""

from hil.sensors.declared import can_protocols, protocols

_HEAD = """# Sold gyros

`hil record serial:/dev/ttyUSB0` and `hil record can:can0` recognise these; `hil record NAME:PLACE` takes one without
looking. This page is generated from the declarations in `hil/sensors` (`python -m tools`), which have what a field
means, its scale, its checksum. Any other gyro on CAN: `--dbc FILE`; one behind a Linux IIO daemon, such as Analog
Devices' ADIS16xxx: `iio:HOST`.

"""


def page() -> str:
    """The page in Markdown."""
    rows = [("name", "gyro", "line", "samples a second", "counter", "source"), ("---",) * 6]
    for name, one in protocols().items():
        counter = f"of {one.counter_size} values" if one.counter_size else "none"
        counter = "a clock" if one.counter_Hz or one.clock_Hz else counter
        bauds = ", ".join(map(str, one.bauds)) + " baud"
        rows.append((f"`{name}`", _noted(one.title, one.note), bauds, _rates(one.rates_Hz), counter, one.source))
    for name, told in can_protocols().items():
        line = f"CAN, {told['bitrate'] // 1000} kbit/s"
        title = _noted(told["title"], told.get("note", ""))
        rows.append((f"`{name}`", title, line, _rates(told["rates_Hz"]), "stamps of the frames", told["source"]))
    return _HEAD + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _noted(title: str, note: str) -> str:
    return f"{title} ({note})" if note else title


def _rates(rates_Hz: tuple[float, ...]) -> str:
    return ", ".join(f"{rate:g}" for rate in rates_Hz)
