"""A run's record is taken with the bench file it was run by, unless another is given."""

from pathlib import Path
from typing import Any

import pytest

import hil as library
from hil.comparing import methods as comparing
from hil.errors import InputError
from hil.replaying import replay as replaying
from hil.tracing import trace as tracing
from hil.tracing.request import TraceRequest
from tests.cli.conftest import Hil, in_lockstep
from tests.cli.test_errors import refused
from tests.records.synthetic_run import Options, write_run

VERBS = ("replay", "trace", "compare")
NAME = "20260101-000000-a"


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run's folder with a bench file of 7 s, where each verb says the bench that it was given and ends."""
    folder = tmp_path / "runs" / NAME
    write_run(folder, Options(seconds=2.0))
    own = in_lockstep("s-slow", duration_s=7.0, settle_s=1.0)
    (folder / "bench.toml").write_text(own, encoding="utf-8")

    def taken(_: Path, bench: Any, *__: object, **___: object) -> None:
        raise InputError(f"by {bench.loop.duration_s}")

    def traced(request: TraceRequest, *_: object, **__: object) -> None:
        taken(request.capture, request.bench)

    monkeypatch.setattr(replaying, "replay", taken)
    monkeypatch.setattr(tracing, "trace", traced)
    monkeypatch.setattr(comparing, "compare", taken)
    return folder


@pytest.mark.moderate
@pytest.mark.parametrize("verb", VERBS)
def test_the_bench_of_a_run_is_its_own(hil: Hil, run: Path, verb: str) -> None:
    for record in ("last", f"runs/{NAME}", f"runs/{NAME}/capture.arrow"):
        assert refused(hil(verb, record)) == "by 7.0"
    assert refused(hil(verb, "last", "--bench", "s-slow")) != "by 7.0"


@pytest.mark.moderate
@pytest.mark.parametrize("verb", VERBS)
def test_a_record_without_a_bench_of_its_own_needs_one(hil: Hil, run: Path, verb: str) -> None:
    (run / "capture.arrow").rename("ride.arrow")
    assert refused(hil(verb, "ride.arrow")) == (
        f"ride.arrow: no bench file belongs to it; name one: hil {verb} ride.arrow --bench FILE"
    )
    assert "nowhere.arrow" in refused(hil(verb, "nowhere.arrow"))


@pytest.mark.moderate
def test_several_records_are_traced_by_a_bench_that_is_named(hil: Hil, run: Path) -> None:
    assert refused(hil("trace", "last", "last")) == "--bench: missing; of several records, name the one for all of them"


@pytest.mark.moderate
@pytest.mark.parametrize("verb", VERBS)
def test_the_library_takes_it_too(run: Path, verb: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    for record in ("last", run, run / "capture.arrow", library.load(run)):
        with pytest.raises(InputError, match="by 7"):
            getattr(library, verb)(record)
