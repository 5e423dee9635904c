"""A catalogue of a hundred thousand runs: made of their folders, looked at, listed, filtered, sorted, compared.

CATALOGUE_RUNS=N for another number, CATALOGUE_FOLDER for another place; the folders say what a real run says, with
other figures, devices and verdicts.  Processor time is that of the call, which a busy machine does not make longer.
"""

import json
import os
import random
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hil
from benchmarks.row import Row
from hil.bench import examples
from hil.running.request import RunRequest
from hil.running.run import run
from hil.service.catalogue import queries
from hil.service.catalogue.catalogue import Catalogue
from hil.service.catalogue.comparing import compare

RUNS = int(os.environ.get("CATALOGUE_RUNS", "100000"))
_TIMES = 15
_DEVICES = 200


def rows(tell: Callable[[str], None]) -> list[Row]:
    """Measure all of it."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("CATALOGUE_FOLDER"), prefix="catalogue-") as place:
        folder = Path(place) / "runs"
        source = _real_run(Path(place) / "real")
        tell(f"{RUNS} folders")
        names = _folders(source, folder)
        private = folder / ".service"
        private.mkdir()
        catalogue = Catalogue(folder, private)
        began, worked = time.perf_counter(), time.process_time()
        found = catalogue.look()
        rebuilt_s, worked_s = time.perf_counter() - began, time.process_time() - worked
        assert found.changed == RUNS
        tell(f"read in {rebuilt_s:.0f} s")
        size = (private / "catalogue.sqlite").stat().st_size
        made = [
            Row("read from the folders, all of it", rebuilt_s, "s"),
            Row("the same for a run", 1e3 * rebuilt_s / RUNS, "ms"),
            Row("database for a run", size / RUNS / 1e3, "kB"),
        ]
        made.insert(1, Row("processor time of it", worked_s, "s"))
        made += [Row(name, value, "s") for name, value in _measured(catalogue, names, tell)]
        catalogue.close()
        return made


def _measured(catalogue: Catalogue, names: list[str], tell: Callable[[str], None]) -> list[tuple[str, float]]:
    """The slowest of several calls of each."""
    drawn = random.Random(3)

    def ask(**given: Any) -> Callable[[], object]:
        return lambda: queries.listed(catalogue, queries.Page(**given))

    far = _page(catalogue, 300)
    acts: dict[str, Callable[[], object]] = {
        "list, first page": ask(),
        "list, page 300": ask(after=far),
        "list, by verdict and device": ask(verdict="failed", serial=f"{7:016x}"),
        "list, two words": ask(q="s-slow 00000000000000c"),
        "list, a word that no run has": ask(q="nowhere"),
        "list, by a figure": ask(where=["angle_error_rms_rad<0.001"]),
        "list, by two figures and a verdict": ask(
            where=["angle_error_rms_rad<0.5", "turnaround_p99_us>100"], verdict="good"
        ),
        "list, sorted by a figure": ask(sort="-angle_error_rms_rad"),
        "list, sorted by a figure, by verdict": ask(sort="angle_error_rms_rad", verdict="failed"),
        "one run": lambda: queries.one(catalogue, drawn.choice(names)),
        "two runs compared": lambda: compare(catalogue, drawn.choice(names), drawn.choice(names)),
        "devices": lambda: queries.devices(catalogue),
        "a device with its figures": lambda: queries.device(catalogue, f"{drawn.randrange(_DEVICES):016x}"),
        "trend of a figure": lambda: queries.trend(catalogue, f"{drawn.randrange(_DEVICES):016x}", "kxx"),
        "a tag given": lambda: catalogue.mark(drawn.choice(names), tags=["seen"]),
        "quick look at the folders": lambda: catalogue.look(whole=False),
        "look at every folder": lambda: catalogue.look(),
    }
    found = []
    for name, act in acts.items():
        times, worked = [], []
        for _ in range(_TIMES if "look at every" not in name else 5):
            catalogue.totals = {}  # as if it were the first time
            began, processor = time.perf_counter(), time.process_time()
            act()
            times.append(time.perf_counter() - began)
            worked.append(time.process_time() - processor)
        tell(
            f"{name}: median {statistics.median(times):.4f} s, at most {max(times):.4f} s, processor "
            f"{statistics.median(worked):.4f} s, at most {max(worked):.4f} s"
        )
        found.append((f"{name}, slowest of {len(times)}", max(times)))
        found.append((f"{name}, processor time", max(worked)))
    return found


def _page(catalogue: Catalogue, number: int) -> str | None:
    """The cursor of a page far down."""
    after = None
    for _ in range(min(number, RUNS // 200) // 10):
        after = queries.listed(catalogue, queries.Page(limit=1000, after=after))["next"]
    return after


def _real_run(out: Path) -> Path:
    changed = {"settle_s": 0.5, "duration_s": 2.0, "clock": "lockstep", "seed": 1}
    link = f"inproc:{examples.find('scenario', 's-slow')}"
    bench = hil.load_bench("s-slow").with_(loop=changed)
    folder = run(RunRequest(bench, link), out, report=False, progress=lambda _: None).folder
    assert folder is not None
    return folder


def _folders(source: Path, out: Path) -> list[str]:
    """Folders of so many runs, two every minute, with figures drawn anew; the newest and the oldest with records."""
    drawn = random.Random(1)
    told = json.loads((source / "result.json").read_text())
    bench = (source / "bench.toml").read_bytes()
    capture = source / "capture.arrow"
    names = []
    for number in range(RUNS):
        stamp = time.strftime("%Y%m%d-%H%M%S", time.localtime(1.6e9 + 30 * number))
        folder = out / f"{stamp}-s-slow"
        folder.mkdir(parents=True)
        good = drawn.random() < 0.9
        result = told | {
            "run": folder.name,
            "verdict": "good" if good else drawn.choice(["failed", "interrupted"]),
            "serial_number": f"{number % _DEVICES:016x}",
            "angle_error_rms_rad": drawn.lognormvariate(-6, 2),
            "rate_error_rms_rad_s": drawn.lognormvariate(-3, 1),
            "turnaround_us": {"p50": 30.0, "p99": drawn.uniform(60, 300), "p999": 400.0},
        }
        parameters = told["parameters"]
        result["parameters"] = parameters | {
            "kxx": parameters["kxx"] | {"value": parameters["kxx"]["value"] * drawn.gauss(1.0, 1e-4)}
        }
        (folder / "result.json").write_text(json.dumps(result))
        (folder / "bench.toml").write_bytes(bench)
        if number % 100 == 0:
            shutil.copyfile(capture, folder / "capture.arrow")
        names.append(folder.name)
    return names
