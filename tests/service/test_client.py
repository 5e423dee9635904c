"""The service from Python and from a terminal: `hil.client`, `hil top`, `hil run --live`, Prometheus' figures."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

import hil
import hil.client
from tests.forked import hil_says
from tests.running.gyro import bench_file, unhurried_bench, unhurried_scenario
from tests.service.serving import Serving, serving


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    place = tmp_path_factory.mktemp("client")
    bench_file(place / "unhurried.bench.toml", unhurried_bench(60.0, clock="lockstep", loop={"settle_s": 1.0}))
    unhurried_scenario(place / "unhurried.scenario.toml")
    with serving(place / "runs") as running:
        yield running


@pytest.mark.slow
def test_a_run_by_the_names_of_the_library(bench: Serving) -> None:
    with hil.client.connect(folder=bench.folder) as service:
        run = service.run("unhurried", link="inproc:unhurried", duration_s=12.0, note="from afar")
        here = hil.load(bench.folder / run.id)
        assert run.verdict == here.verdict
        assert run.result.operator_note == "from afar"
        assert (run.estimates["rate_rad_s"] == here.estimates["rate_rad_s"]).all()
        assert (run.angle.values == here.angle.values).all()
        assert run.bench == here.bench
        assert "<html" in run.report().read_text()[:200]
        assert [row["id"] for row in service.runs()] == [run.id]
        assert service.load("last").id == run.id
        assert service.state["lease"] is None  # given back


@pytest.mark.moderate
def test_what_is_refused_is_one_line(bench: Serving) -> None:
    with hil.client.connect(bench.url, bench.token()) as service:
        with pytest.raises(hil.InputError, match=r"no such run|no run"):
            service.load("20200101-000000-none").result  # noqa: B018
        with service.board("a test", holder="Ada"):
            with pytest.raises(hil.InputError, match="Ada has the board"):
                service.run("unhurried", link="inproc:unhurried")
            assert service.state["lease"]["holder"] == "Ada"
    for given in ({"url": bench.url, "token": "x"}, {"url": "http://127.0.0.1:9/", "token": "x"}, {"folder": "none"}):
        with pytest.raises(hil.InputError) as refused:
            hil.client.connect(**given)
        assert "\n" not in str(refused.value)


@pytest.mark.moderate
def test_a_link_with_its_token_is_enough(bench: Serving) -> None:
    (link,) = bench.links.values()
    with hil.client.connect(link) as service:
        assert service.state["state"] in (None, "IDLE", "SAFE")


@pytest.mark.moderate
def test_the_figures_for_prometheus(bench: Serving) -> None:
    assert bench.ask("GET", "/metrics", token="").status_code == 401
    answer = bench.ask("GET", "/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    found = {family.name: family for family in text_string_to_metric_families(answer.text)}
    states = {sample.labels["state"]: sample.value for sample in found["hil_board_state"].samples}
    assert set(states) >= {"SAFE", "RUNNING", "LOST"}
    assert sum(states.values()) <= 1.0
    assert found["hil_run_active"].samples[0].value == 0.0
    assert "hil_board_connected" in found


@pytest.mark.slow
def test_top_says_what_the_board_does(bench: Serving) -> None:
    said = hil_says("top", "--once", "--folder", str(bench.folder))
    assert said.returncode == 0, said.stderr
    assert "board" in said.stdout
    state = json.loads(hil_says("top", "--json", bench.links["administer"]).stdout)
    assert state["kind"] == "state"
    gone = hil_says("top", "--once", "--folder", "nowhere")
    assert gone.returncode == 2
    assert "hil serve" in gone.stderr


@pytest.mark.long
def test_a_run_with_its_page(tmp_path: Path) -> None:
    out = tmp_path / "runs"
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    said = hil_says("run", "s-slow", "--link", "inproc:s-slow", "--clock", "lockstep", "--duration", "12",
                    "--live", "--json", "--out", str(out), env=environment)  # fmt: skip
    assert said.returncode in (0, 1), said.stderr
    assert "#token=" in said.stderr
    assert json.loads(said.stdout)["samples"] == 48_000
    assert not (out / ".service" / "serve.json").exists()
    refused = hil_says("run", "s-slow", "--live", "--dry-run")
    assert refused.returncode == 2
    assert "--live" in refused.stderr
