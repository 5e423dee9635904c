"""An algorithm of one's own in the loop: observer, controller, or both, recorded and judged as the bench's own."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hil
from hil.bench import override
from hil.errors import InputError
from hil.plugins import finding
from hil.plugins.of_bench import require_supported
from hil.progress import untold
from hil.records.runfolder import RunFolder
from hil.replaying.replay import replay
from hil.report.page import render
from hil.running.process.live_settings import at_once
from hil.scoring.score import score
from tests.plugins.running import HERE, OWN, bench, ran
from tests.running.closed import angle_errors

pytestmark = pytest.mark.usefixtures("no_report")

ANGLE_RAD = 5e-3
"""Error after settling: with the bench's own algorithm on this board it is a millirad."""
LAW, BARE = f"{HERE / 'own.py'}:Law", f"{HERE / 'own.py'}:Bare"


def error_rad(run: RunFolder, place: Path) -> float:
    return float(np.sqrt(np.mean(angle_errors(run, place / "truth.arrow", 0.8) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("observer", "controller"), [(OWN, None), (None, LAW), (OWN, LAW), (OWN, OWN), (None, OWN.replace("Own", "Law"))]
)
def test_it_closes_the_loop_and_its_estimates_are_recorded(
    tmp_path: Path, observer: str | None, controller: str | None
) -> None:
    run = ran(tmp_path, bench(observer, controller))
    result = run.result
    assert result is not None
    assert (result.samples, result.complete) == (8000, True)
    assert result.parts["safety"].outcome == "good"
    assert error_rad(run, tmp_path) < ANGLE_RAD
    assert run.estimates is not None
    named = {"observer": observer, "controller": controller}
    assert run.estimates.header["plugins"] == {
        kind: name.rpartition("/")[2] for kind, name in named.items() if name is not None
    }
    assert any("in Python" in remark and "which holds about" in remark for remark in result.remarks)
    assert (run.covariance is None) == (observer is not None)
    assert result.parameters["kxx"].ci95[0] < result.parameters["kxx"].value


@pytest.mark.slow
def test_what_an_observer_does_not_tell_is_told_as_missing(tmp_path: Path) -> None:
    run = ran(tmp_path, bench(BARE))
    result = run.result
    assert result is not None
    assert result.angle_expanded_rad is None
    assert result.parts["angle"].outcome == "unknown", result.parts["angle"].reason
    assert "gives no uncertainty of its angle" in result.parts["angle"].reason
    assert run.estimates is not None
    assert np.isnan(run.estimates.sd("rate_rad_s")).all()
    assert {one.ci95 for one in result.parameters.values()} == {None}
    assert result.angle is not None
    assert result.angle.why == "the plug-in's own formula"
    assert result.angle.plain_rad is result.angle.control_imperfection_rms_rad is None
    page = " ".join(render(run).split())
    assert "Its uncertainty is not given." in page
    declared = [name for name, one in result.parameters.items() if one.declared]
    assert page.count("± not given") == len(result.parameters) - len(declared)
    assert page.count("(declared)") == len(declared)
    assert "already subtracted" not in page
    assert np.isfinite(run.estimates["energy_ratio"]).all()
    assert result.innovation_rms is not None
    scored = score(run.path, tmp_path / "truth.arrow")
    assert scored.score is not None
    assert scored.score.coverage.get("rate") is None
    assert "by the truth" in scored.parts["angle"].reason
    assert scored.parts["angle"].outcome == "good"


@pytest.mark.slow
def test_a_replay_has_it_again_on_the_record(tmp_path: Path) -> None:
    declared = bench(OWN)
    run = ran(tmp_path, declared)
    again = replay(run.capture_path, declared, tmp_path / "again", progress=untold)
    assert again.folder is not None
    ours, theirs = RunFolder(again.folder).estimates, run.estimates
    assert ours is not None
    assert theirs is not None
    assert np.array_equal(ours["angle_rad"], theirs["angle_rad"])


@pytest.mark.slow
def test_a_comparison_has_a_row_for_it(tmp_path: Path) -> None:
    declared = bench(OWN)
    run = ran(tmp_path, declared)
    found = hil.compare(run.path, declared, truth=tmp_path / "truth.arrow", out=tmp_path / "compared")
    rows = {row.name: row for row in found.rows}
    named = rows["plug-in own.py:Own"]
    assert named.angle_error_rms_rad is not None
    assert named.angle_error_rms_rad < ANGLE_RAD
    assert run.result is not None
    assert named.angle_u_rad == pytest.approx(run.result.angle_u_rad, rel=1e-9)
    assert named.angle_expanded_rad == pytest.approx(run.result.angle_expanded_rad, rel=1e-9)
    assert "13 states, fading" in rows


@pytest.mark.slow
def test_the_textbook_way_stands_beside_the_source_s_on_one_record(tmp_path: Path) -> None:
    """The template: an adaptive observer of springs and rate, Friedland and Hutton's angle; damping is left out."""
    template = f"{Path(finding.__file__).parent / 'templates' / 'observer.py'}:MyObserver"
    run = ran(tmp_path, bench())
    found = hil.compare(run.path, bench(template), truth=tmp_path / "truth.arrow", out=tmp_path / "compared")
    rows = {row.name: row for row in found.rows}
    textbook, source = rows["plug-in observer.py:MyObserver"], rows["13 states, fading"]
    assert textbook.diverged_s is None
    assert textbook.angle_error_rms_rad is not None
    assert source.angle_error_rms_rad is not None
    assert source.angle_error_rms_rad < textbook.angle_error_rms_rad < 0.1
    assert textbook.stiffness_error is not None
    assert textbook.stiffness_error < 0.005  # declared they are off by 0.03
    assert textbook.damping_error is None  # of what it does not estimate


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nowhere.py:Mine", "no file nowhere.py"),
        ("nowhere.so", "no file nowhere.so"),
        (f"{HERE / 'own.py'}:Missing", "has no Missing"),
        (f"{HERE / 'own.py'}:Law", "a class with a method observe is expected"),
        (f"{HERE / 'own.py'}", "expected FILE.py:CLASS"),
        ("not-installed", "no such plug-in"),
        ("broken.py:Mine", "cannot be loaded: SyntaxError"),
        ("failing.py:Mine", "cannot be loaded: ZeroDivisionError: division by zero, failing.py line 1"),
        ("text.so", "cannot be loaded"),
    ],
)
def test_a_name_that_leads_nowhere_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.py").write_text("class Mine(:\n")
    (tmp_path / "failing.py").write_text("1 / 0\n")
    (tmp_path / "text.so").write_text("no library\n")
    with pytest.raises(InputError) as refusal:
        ran(tmp_path, bench(name))
    assert words in str(refusal.value)
    assert "[observer] plugin" in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert not any((tmp_path / "runs").iterdir())


@pytest.mark.parametrize("mode", ["gain", "board"])
@pytest.mark.parametrize("named", [(OWN, None), (None, LAW)])
def test_where_the_board_computes_the_drive_it_is_refused(named: tuple[str | None, str | None], mode: str) -> None:
    with pytest.raises(InputError, match=r"plugin own.py:(Own|Law): in \[loop\] mode"):
        require_supported(bench(*named, changes={"loop": {"mode": mode, "block": 200}, "link": {"watchdog_s": 0.5}}))


def test_a_controller_that_the_bench_would_move_is_refused() -> None:
    with pytest.raises(InputError, match="stiffness_step"):
        require_supported(bench(None, LAW, changes={"controller": {"stiffness_step": 0.01}}))
    effects: dict[str, dict[str, Any]] = {"effects": {"drive_gain": {}}}
    with pytest.raises(InputError, match=r"cannot undo \[effects.drive_gain\]"):
        require_supported(override(bench(OWN), effects, "test"))
    require_supported(override(bench(OWN, OWN), effects, "test"))


def test_settings_that_a_plug_in_does_not_hear_of_wait_for_the_next_start() -> None:
    assert (
        "the plug-in of [controller] drives" in at_once(bench(None, LAW), {"virtual_rotation": 1.0})["virtual_rotation"]
    )
    assert at_once(bench(OWN), {"virtual_rotation": 1.0}) == {"virtual_rotation": ""}


def test_a_file_is_looked_for_beside_the_bench_file(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text((HERE / "own.py").read_text())
    text = (Path(__file__).parents[2] / "examples" / "s-slow.bench.toml").read_text()
    there = tmp_path / "mine.bench.toml"
    there.write_text(text.replace("[observer]\n", '[observer]\nplugin = "mine.py:Own"\n'))
    assert hil.load_bench(str(there)).observer.plugin == f"{tmp_path / 'mine.py'}:Own"


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that brings a plug-in."""
    from tests.plugins.own import Own

    def there(group: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(name="own", value="x:Own", load=lambda: Own)] if group == "hil.observers" else []

    monkeypatch.setattr(finding, "entry_points", there)


@pytest.mark.usefixtures("installed")
@pytest.mark.slow
def test_an_installed_package_brings_one_by_name(tmp_path: Path) -> None:
    run = ran(tmp_path, bench("own", duration_s=1.0))
    assert run.estimates is not None
    assert run.estimates.header["plugins"] == {"observer": "own"}


@pytest.mark.usefixtures("installed")
def test_from_elsewhere_only_what_is_installed_may_be_named() -> None:
    finding.require_no_files(bench("own"), "bench_toml")
    for name in (OWN, "mine.so", "./mine.py:A"):
        with pytest.raises(InputError, match="of this machine only"):
            finding.require_no_files(bench(None, name), "bench_toml")


@pytest.mark.slow
def test_a_dry_run_tries_it_and_arms_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"own\.py:Missing"):
        ran(tmp_path, bench(f"{HERE / 'own.py'}:Missing"), dry_run=True)
