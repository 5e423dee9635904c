"""The tables of the page."""

from hil.errors import InputError
from hil.numbers import count, in_both, percent, plus_minus, prefix_for, relative, significant
from hil.records.result import Constant
from hil.records.units import symbol_of
from hil.report.markup import paragraph, table
from hil.report.material import Material

_COUNTED = {
    "samples": "rows of the capture",
    "lost": "samples missing between the first and the last",
    "stopped": "of these, while the board was SAFE until it was armed again",
    "skipped": "of these, that the board left out: it streamed, and no frame is missing for them",
    "held": "samples before which the board held its last drive, whatever the reason",
    "clipped": "samples with the converter at its end",
    "saturated": "samples with the drive at its limit",
    "estimates": "estimates of the board's own, recorded",
    "rearmed": "times the board was armed again after a SAFE",
    "residual_safe": "times the innovation exceeded its limit and the host sent SAFE",
    "frames_lost": "frames missing from the board's sequence",
    "frames_repeated": "frames that came twice, or after a later one, and were dropped",
    "frames_damaged": "frames the host dropped: framing, checksum, length or type",
    "frames_passed_over": "optional messages of the board that this host does not know",
    "board_late": "drives that reached the board after their tick",
    "board_held": "ticks at which the board held its last drive, before and after the record, too",
    "board_bad_frames": "frames the board dropped: framing, checksum, length or type",
    "board_lost_seq": "frames the board missed in the host's sequence",
    "board_saturated": "drive codes the board had to limit",
    "board_watchdog_trips": "times its watchdog brought the board to SAFE",
    "board_dropped": "blocks of samples the board could not send",
}


_OF_A_PROCESSOR = {
    "waited": "loop waited for a processor", "stolen": "used by the hypervisor", "pressed": "CPU fully loaded",
}  # fmt: skip


def angle(material: Material) -> str:
    """Where the errors of angle and rate come from, when the run has been scored."""
    result, score = material.result, material.result.score
    if score is None:
        return ""
    of_pattern = [
        ("pattern angle less the virtual rotation", score.pattern_angle_error_rms_rad, None, "rad"),
        ("of it, estimation error", score.angle_estimation_error_rms_rad, None, "rad"),
        ("of it, control imperfection", score.control_imperfection_rms_rad, None, "rad"),
    ]
    held = material.folder.bench.get("controller", {}).get("mode") in ("force_to_rebalance", "mode_reversal")
    entries = [
        ("reported angle minus true rotation", result.angle_error_rms_rad, score.angle_error_max_rad, "rad"),
        *([] if held else of_pattern),  # a pattern that is held on purpose does not turn with the board
        ("rate", result.rate_error_rms_rad_s, score.rate_error_max_rad_s, "rad/s"),
    ]
    rows = [
        (
            name,
            in_both(rms, unit),
            "" if largest is None else in_both(largest, unit),
        )
        for name, rms, largest, unit in entries
        if rms is not None
    ]
    start, stop = score.window_s
    caption = (
        f"Errors over {count(score.rows)} instants from {significant(start)} to {significant(stop)} s, "
        f"{significant(score.turns)} rotations"
    )
    return table(caption, ("error", "rms", "largest"), rows, (1, 2)) if rows else ""


def on_board(material: Material) -> str:
    """The board's own estimates beside the host's, and beside the truth once scored."""
    found = material.result.board
    if found is None:
        return ""
    rows = [
        (name, in_both(value, unit))
        for name, value, unit in (
            ("board's angle less the host's, rms", found.angle_difference_rms_rad, "rad"),
            ("the same, at the end", found.angle_difference_end_rad, "rad"),
            ("board's rate less the host's, rms", found.rate_difference_rms_rad_s, "rad/s"),
            ("board's angle less the true rotation, rms", found.angle_error_rms_rad, "rad"),
            ("board's rate less the true one, rms", found.rate_error_rms_rad_s, "rad/s"),
        )
        if value is not None
    ]
    if found.valid_fraction is not None:
        rows.append(("share of the time that it calls its angle valid", percent(found.valid_fraction)))
    return table(f"On the board: {count(found.rows)} estimates of its own", ("figure", "value"), rows, (1,))


def parameters(material: Material) -> str:
    """Constants at the end of the run beside truth, or else beside the bench file's values."""
    entries = material.result.parameters
    if not entries:
        return ""
    scored = any(entry.truth is not None for entry in entries.values())
    head = ["parameter", "estimate", "unit", "truth" if scored else "declared", "deviation"]
    if scored:  # what a data sheet declares need not lie in the interval
        head.append("inside interval")
    rows = [_parameter_row(material, symbol, entries[symbol])[: len(head)] for symbol in sorted(entries, key=rank)]
    return table("Constants at the end of the run, ± half of the 95 % interval", head, rows, (1, 3, 4))


def coverage(material: Material) -> str:
    """How often the stated intervals held the truth."""
    score = material.result.score
    if score is None or not score.coverage:
        return ""
    names = [shown(symbol_of(name)) for name in score.coverage]
    held = [percent(fraction) for fraction in score.coverage.values()]
    caption = "Share of instants whose 95 % interval held the truth (instants of one run are correlated)"
    half = -(-len(names) // 2)
    rows = [
        (
            names[row],
            held[row],
            *((names[row + half], held[row + half]) if row + half < len(names) else ("", "")),
        )
        for row in range(half)
    ]
    return table(caption, ("state", "held", "state", "held"), rows)


def answers(material: Material) -> str:
    """What became of each sample: the one count that every figure of deadlines and loss comes from."""
    counted = material.result.answers
    if counted is None:
        return ""
    rows = [(name, count(part), percent(part / counted.ticks, 2)) for name, part in counted.parts.items()]
    rows.append(("all", count(counted.ticks), percent(1.0, 2)))
    return table("What became of each sample", ("", "samples", "share"), rows, (1, 2))


def counters(material: Material) -> str:
    result = material.result
    entries = {"samples": result.samples, "lost": result.lost, **result.counters}
    rows = [(name.replace("_", " "), count(value), _COUNTED.get(name, "")) for name, value in entries.items()]
    return table("What was counted", ("counter", "count", "meaning"), rows, (1,))


def ledger(material: Material) -> str:
    """The board's clock, where the time of a block went, and what the host needed of a core."""
    result = material.result
    parts = []
    if result.holds is not None:
        parts.append(paragraph(f"What this machine, as it was, holds on that link: {result.holds.line}."))
    if result.board_clock is not None:
        clock = result.board_clock
        parts.append(paragraph(f"Times are in {clock.time_base}. The board's clock: {clock.line}."))
        if clock.sample_rate is not None:
            parts.append(paragraph(f"Sample rate: {clock.sample_rate.line}."))
    if (beside := result.reference) is not None:
        device = beside.link if beside.sensor is None else beside.sensor.device
        counted = f"{beside.samples} samples, {beside.lost} missing; silent for {beside.silent_s:.2g} s at the longest"
        parts.append(paragraph(f"Beside the reference, {device} ({counted}): {beside.line}. {beside.stopped}"))
    if result.ledger_us is not None:
        rows = [
            (name, *(significant(value) for value in times.values()), field.description or "")
            for (name, times), field in zip(
                result.ledger_us.model_dump().items(), type(result.ledger_us).model_fields.values(), strict=True
            )
        ]
        head = ("stage", "p50 / µs", "p99 / µs", "p99.9 / µs", "")
        parts.append(table("A block of samples, from the sampling of its last row on", head, rows, (1, 2, 3)))
    if result.load is not None:
        fields = type(result.load).model_fields
        rows = [
            (_OF_A_PROCESSOR.get(name, name), percent(share), fields[name].description or "")
            for name, share in result.load.model_dump(exclude_none=True).items()
        ]
        parts.append(table("Processor time that the host used, and that it did not get", ("", "share", ""), rows, (1,)))
    return "".join(parts)


def algorithm(material: Material) -> str:
    rows = [
        (
            shown(told.name),
            "not known" if told.value is None else f"{significant(told.value)} {shown_unit(told.unit)}".strip(),
            "" if told.limit is None else f"{significant(told.limit)} {shown_unit(told.unit)}".strip(),
        )
        for told in material.result.algorithm
    ]
    return table("What the algorithm tells of itself", ("", "value", "limit"), rows, (1, 2)) if rows else ""


def provenance(material: Material) -> str:
    """What ran, on what, with which versions."""
    result = material.result
    entries: list[tuple[str, str]] = [("run", result.run)]
    for name, value in (
        ("serial number", result.serial_number),
        ("operator's note", result.operator_note),
        ("link", result.link),
        ("clock", result.clock),
    ):
        if value:
            entries.append((name, value))
    entries.append(("length", f"{significant(result.seconds, 4)} s of bench time"))
    entries.append(("record", "complete" if result.complete else "interrupted: no end marker"))
    entries += list(result.versions.items())
    return table("What ran, and with which versions", ("item", "value"), entries)


def device(material: Material) -> str:
    """What the bench file's numbers come to; nothing for one that this version does not read, or of a rate sensor."""
    from hil.bench import Bench
    from hil.bench.derived import derived
    from hil.toml.reading import parse_table

    try:
        bench = parse_table(material.folder.bench, Bench, "bench.toml")
    except InputError:
        return ""
    return table("The device as declared", ("", "value"), [(line.name, line.text) for line in derived(bench)])


def _parameter_row(material: Material, symbol: str, entry: Constant) -> tuple[str, ...]:
    factor, prefix = prefix_for(entry.value) if entry.unit == "V" else (1.0, "")
    value, half = entry.value * factor, (entry.half or 0.0) * factor
    unsaid = " (declared)" if entry.declared else " ± not given" if entry.half is None else ""
    told = plus_minus(value, half) + unsaid
    start = (shown(symbol), told, prefix + shown_unit(entry.unit))
    reference = entry.truth if entry.truth is not None else _declared(material, symbol, entry.unit)
    if reference is None:  # as of a coefficient that no truth or bench file has by this name
        return *start, "–", "–", "–"
    deviation = entry.value - reference
    return (
        *start,
        plus_minus(value, half, beside=reference * factor),
        relative(deviation / abs(reference)) if reference else "–",
        "declared" if entry.declared else _inside(abs(deviation), entry.half),
    )


def _inside(deviation: float, half: float | None) -> str:
    if half is None:
        return "not given"
    return "yes" if deviation <= half else f"no, {significant(deviation / half, 2)} × half"


def _declared(material: Material, symbol: str, unit: str) -> float | None:
    """The bench file's value in the unit of the table."""
    device = material.folder.bench.get("device", {})
    for suffix in ("_per_s2", "_per_s"):
        known = material.constant(symbol + suffix)
        if known is not None:
            return known[0] * (float(device["mass_kg"]) if unit.startswith("N") else 1.0)
    return None


_SYMBOLS = {
    "x": "x",
    "vx": "ẋ",
    "y": "y",
    "vy": "ẏ",
    "phi_x": "Φx",
    "phi_y": "Φy",
    "rate": "Ω",
}


def shown(symbol: str) -> str:
    """`phi_x` → `Φx`, `drive_gain_x` → `drive gain x`; others as they are."""
    return _SYMBOLS.get(symbol, symbol.replace("_", " "))


def shown_unit(unit: str) -> str:
    """The unit, nothing for a pure number."""
    return "" if unit == "1" else unit


def rank(symbol: str) -> tuple[int, str]:
    """Sort key: stiffness, damping, other coefficients, offsets; the diagonal before the cross term."""
    if symbol.startswith("phi_"):
        return 3, symbol
    group = {"k": 0, "d": 1}.get(symbol[0], 2) if symbol[1:] in ("xx", "yy", "xy") else 2
    return group, symbol.replace("xy", "zz")
