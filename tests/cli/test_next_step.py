"""Every verdict ends with the command that comes next: of a trace and of a comparison, by what was taken and found."""

from pathlib import Path
from typing import Any

import pytest

from hil.bench import load_bench
from hil.bench.examples import find
from hil.bench.template import template, values_of
from hil.records.atomic import write_sealed
from hil.records.diagnosis import Coefficient, Diagnosis, FormTerm, MissingForce, Separation
from hil.records.methods import MethodRow, Methods
from hil.records.result import Result, save_result
from hil.records.runfolder import RunFolder
from hil.verdict.next_step import PASSING, after_comparison, after_trace
from tests.cli.diagnoses import explained


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A trace's folder beside the run "ride", of two axes."""
    monkeypatch.chdir(tmp_path)
    Path("runs/ride").mkdir(parents=True)
    trace = Path("runs/trace")
    trace.mkdir()
    (trace / "bench.toml").write_text("[device]\naxes = 2\n", encoding="utf-8")
    return trace


def found(verdict: str, **said: Any) -> Diagnosis:
    return explained(**({"record": "ride"} | said)).model_copy(update={"verdict": verdict})


def missing(*coefficients: tuple[float, float], refused: str | None = None) -> MissingForce:
    """A force whose form is a cube with such intervals; none without any."""
    law: dict[str, Any] = {"form": "q**3", "sensed": False, "laws": {"both": ("x**3", "y**3")}}
    form = tuple(
        FormTerm(**law, coefficients={"both": Coefficient(value=sum(ci95) / 2, ci95=ci95, unit="1/(m²·s²)")})
        for ci95 in coefficients
    )
    figures = dict.fromkeys(("rms_mps2", "deviation_mps2", "left", "innovation_before", "innovation_after"))
    return MissingForce(form=form, text="a force", refused=refused, **figures)  # type: ignore[arg-type]


AGAIN = "hil trace runs/ride --bench runs/trace/bench.toml"
ALIKE = Separation.model_validate(
    {
        "effect": "a",
        "with": "b",
        "correlation": 1.0,
        "separate_by": "half the amplitude",
        "expected": None,
        "experiment": "amplitude",
    }
)


@pytest.mark.parametrize(
    ("diagnosis", "command"),
    [
        (found("explained"), "hil show runs/trace --add better.bench.toml"),
        (found("adequate"), "hil export runs/ride --what angle"),
        (found("partly explained", separations=(ALIKE,)), f"{AGAIN} --live"),
        (found("unexplained"), f"{AGAIN} --missing-force"),
        (found("unexplained", missing_force=missing((1.0, 3.0))), "hil show runs/trace --add better.bench.toml"),
        (found("unexplained", missing_force=missing((-1.0, 3.0))), "hil export runs/trace --what force"),
        (found("unexplained", missing_force=missing()), "hil export runs/trace --what force"),
        (
            found("unexplained", missing_force=missing(refused="too short")),
            "hil trace OTHER.arrow --bench runs/trace/bench.toml",
        ),
        (found("explained", record="2 records: a, b"), "hil trace OTHER.arrow --bench runs/trace/bench.toml"),
    ],
)
def test_after_the_trace_of_a_run(folder: Path, diagnosis: Diagnosis, command: str) -> None:
    assert after_trace(folder, diagnosis) == command
    assert after_trace(folder, diagnosis, record=Path("runs/ride/capture.arrow")) == command


def test_an_imported_record_is_named_by_its_file(folder: Path) -> None:
    there = Path("records/my ride.arrow")
    again = f"hil trace 'records/my ride.arrow' --bench {folder}/bench.toml"
    assert after_trace(folder, found("explained"), record=there) == "hil show runs/trace --add better.bench.toml"
    told = after_trace(folder, found("adequate"), record=there)
    assert told == f"hil replay 'records/my ride.arrow' --bench {folder}/bench.toml"
    alike = found("partly explained", separations=(ALIKE,))  # of which there is no board to make the experiment on
    assert after_trace(folder, alike, record=there) == f"{again} --missing-force"
    kept = found("unexplained", record="elsewhere")  # shown again, nobody knows where it was
    assert after_trace(folder, kept) == f"hil trace elsewhere.arrow --bench {folder}/bench.toml --missing-force"


@pytest.mark.parametrize(
    ("link", "as_run", "options"),
    [
        ("inproc:s-still", {}, "--link inproc:s-still"),
        (f"pty:{find('scenario', 's-slow')}", {}, ""),
        ("pty:my board.toml", {}, "--link 'pty:my board.toml'"),
        (
            "inproc:s-slow",
            {"loop": {"clock": "lockstep", "duration_s": 12.5, "seed": 4}, "controller": {"enabled": False}},
            "--link inproc:s-slow --clock lockstep --duration 12.5 --seed 4 --open-loop",
        ),
    ],
)
def test_the_run_with_what_was_added_is_as_the_run_before(
    folder: Path, link: str, as_run: dict[str, Any], options: str
) -> None:
    """At its link, with its options: what the file that declares the effect says otherwise."""
    added = Path("better.bench.toml")
    added.write_text(find("bench", "s-slow").read_text(encoding="utf-8"), encoding="utf-8")
    declared = load_bench(added)
    run = RunFolder(Path("runs/ride"))
    write_sealed(run.bench_path, template(values_of(declared.with_(**as_run)), "The bench as run."))
    save_result(run.result_path, Result(run="ride", link=link, seconds=1.0, samples=1, lost=0, late=0, complete=True))
    told = after_trace(folder, found("explained"), added)
    assert told == f"hil run better.bench.toml {options}".rstrip()


def test_what_was_added_is_tried_on_the_record(folder: Path) -> None:
    added = Path("better.bench.toml")
    told = after_trace(folder, found("explained"), added, record=Path("ride.arrow"))
    assert told == "hil replay ride.arrow --bench better.bench.toml"


def test_arrays_from_memory_are_in_no_file_that_lasts(folder: Path) -> None:
    """What `hil.trace` and `hil.compare` write of them to work on is gone when they are done."""
    passing = folder.parent / f"{PASSING}x1y2" / "arrays.arrow"
    told = after_trace(folder, found("explained", record="arrays"), record=passing)
    assert told == "hil show runs/trace --add better.bench.toml"
    methods = Methods(record="arrays", bench="b", seconds=3.0, window_s=(1.0, 3.0), rows=())
    assert after_comparison(folder, methods, record=passing) == "hil trace ARRAYS.arrow --bench runs/trace/bench.toml"


@pytest.mark.parametrize("device", ["axes = 0", 'axes = 1\n[device.sense]\nsenses = "envelope"'])
@pytest.mark.parametrize("verdict", ["adequate", "explained", "partly explained", "unexplained"])
def test_what_no_bench_file_can_declare_is_looked_for_on_another_record(
    folder: Path, device: str, verdict: str
) -> None:
    (folder / "bench.toml").write_text(f"[device]\n{device}\n", encoding="utf-8")
    told = after_trace(folder, found(verdict), record=Path("ride.arrow"))
    assert told == f"hil trace OTHER.arrow --bench {folder}/bench.toml"


def test_a_single_axis_has_estimates_and_no_angle(folder: Path) -> None:
    (folder / "bench.toml").write_text("[device]\naxes = 1\n", encoding="utf-8")
    assert after_trace(folder, found("adequate")) == "hil export runs/ride --what estimates"


def test_after_a_comparison_the_record_is_traced(folder: Path) -> None:
    row = MethodRow(name="13 states, fading", kind="observer", record="this")
    methods = Methods(record="ride", bench="b", seconds=3.0, window_s=(1.0, 3.0), rows=(row,))
    assert after_comparison(folder, methods) == AGAIN
    told = after_comparison(folder, methods, record=Path("ride.arrow"))
    assert told == f"hil trace ride.arrow --bench {folder}/bench.toml"
    carried = methods.model_copy(update={"rows": (row, row.model_copy(update={"kind": "traced"}))})
    assert after_comparison(folder, carried) == f"{AGAIN} --add better.bench.toml"
