"""What the verdicts were worth, in figures."""

from collections.abc import Sequence

from benchmarks.row import Row
from benchmarks.verdicts.campaign import Line


def summarise(lines: Sequence[Line]) -> list[Row]:
    """Rows for runs/bench.json. An error is the rms over the scored window against the truth, as `hil score` says."""
    ran = [line for line in lines if "failed" not in line]
    good = [line for line in ran if line["verdict"] == "good" and line["error_rms_rad"] is not None]
    bounded = [line for line in good if line["angle_expanded_rad"]]
    over = {
        factor: sum(line["error_rms_rad"] > factor * line["angle_expanded_rad"] for line in bounded)
        for factor in (1, 3)
    }
    ends = sum(abs(line["error_end_rad"]) > line["angle_expanded_rad"] for line in bounded)
    most = sum(line["error_max_rad"] > line["angle_expanded_rad"] for line in bounded)
    clean = [line for line in ran if line["category"] == "clean"]
    covered = [line for line in clean if line["angle_expanded_rad"]]
    within = sum(abs(line["error_end_rad"]) <= line["angle_expanded_rad"] for line in covered)
    seconds = sorted(line["scan"]["seconds"] for line in ran if line["scan"])
    rows = [
        Row("runs", len(lines), ""),
        Row("runs that ended in an error", len(lines) - len(ran), ""),
        Row("verdict good", len(good), ""),
        Row("good and error above U", share(over[1], len(bounded)), "%"),
        Row("good and error above 3 U", over[3], ""),
        Row("good and error at the end above U", share(ends, len(bounded)), "%"),
        Row("good and largest error above U", share(most, len(bounded)), "%"),
        Row("clean: verdict good", share(sum(line["verdict"] == "good" for line in clean), len(clean)), "%"),
        Row("clean: model complete", share(sum(complete(line) for line in clean), len(clean)), "%"),
        Row("clean: error at the end within U", share(within, len(covered)), "%"),
        Row("clean: U over the error, rms of all", over_rms(covered), ""),
        Row("scan, median", seconds[len(seconds) // 2] if seconds else 0.0, "s"),
    ]
    for category in ("single", "extreme"):
        of = [line for line in ran if line["category"] == category]
        rows.append(
            Row(f"{category}: verdict good", share(sum(line["verdict"] == "good" for line in of), len(of)), "%")
        )
    return rows


def complete(line: Line) -> bool:
    """Whether the model's part has nothing against it."""
    return bool(line["parts"]["model"]["outcome"] == "complete")


def share(count: int, of: int) -> float:
    """Per cent."""
    return 100.0 * count / of if of else 0.0


def over_rms(lines: Sequence[Line]) -> float:
    """U over the error at the end, each as its rms over the lines."""
    squares = sum(line["error_end_rad"] ** 2 for line in lines)
    return float((sum(line["angle_expanded_rad"] ** 2 for line in lines) / squares) ** 0.5) if squares else 0.0
