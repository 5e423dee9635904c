"""GET /metrics: the bench for Prometheus, for soaks that last days."""

from collections.abc import Iterable
from typing import Any

from fastapi import APIRouter, Request
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from starlette.responses import Response

from hil.service.routes_board import board_of
from hil.service.service import service_of

router = APIRouter(tags=["service"])
_STATES = ("BOOT", "IDLE", "ARMED", "RUNNING", "SAFE", "LOST")
_GAUGES = {
    "t_s": ("hil_bench_time_seconds", "Bench time of the run"),
    "angle_rad": ("hil_angle_radians", "Angle of rotation"),
    "angle_u_rad": ("hil_angle_standard_uncertainty_radians", "Standard uncertainty of the angle, k = 1"),
    "angle_expanded_rad": ("hil_angle_expanded_uncertainty_radians", "Expanded uncertainty of the angle, k = 2"),
    "rate_rad_s": ("hil_rate_radians_per_second", "Rate of rotation"),
    "rate_u": ("hil_rate_standard_uncertainty_radians_per_second", "Standard uncertainty of the rate, k = 1"),
    "energy_ratio": ("hil_energy_ratio", "Energy of the vibration over its set point"),
    "quadrature_ratio": ("hil_quadrature_ratio", "Quadrature over the energy"),
}
_COUNTS = {
    "samples": ("hil_samples", "Samples of this run that were looked at"),
    "lost": ("hil_samples_lost", "Samples of this run that did not come"),
    "held": ("hil_samples_held", "Samples at which the board held its drive because no answer came"),
    "late": ("hil_answers_late", "Samples of this run whose answer reached the board after its effective tick"),
}


@router.get("/metrics", response_class=Response)
async def metrics(request: Request) -> Response:
    """Figures of the board and its run in Prometheus' text format."""
    live = service_of(request).parts["live"]
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Told(board_of(request).state, live.now(), len(live.clients)))
    return Response(generate_latest(registry), media_type="text/plain; version=0.0.4; charset=utf-8")


class _Told:
    """One moment, as Prometheus collects it."""

    def __init__(self, board: dict[str, Any], now: dict[str, Any] | None, clients: int) -> None:
        self._board, self._now, self._clients = board, now or {}, clients

    def collect(self) -> Iterable[Metric]:
        """The figures there are; what the run does not have is left out."""
        board, now, health = self._board, self._now, self._board["health"]
        answers = board["connected"] and not board["lost"]
        yield _gauge("hil_board_connected", "1 while a board is connected and answers", answers)
        states = GaugeMetricFamily("hil_board_state", "1 for the state that the board is in", labels=["state"])
        for state in _STATES:
            states.add_metric([state], float(board["state"] == state))
        yield states
        yield _gauge("hil_run_active", "1 while a run lasts, its report included", board["run"] is not None)
        yield _gauge("hil_live_clients", "Clients of the live connection", self._clients)
        for name, (metric, words) in _GAUGES.items():
            if now.get(name) is not None:
                yield _gauge(metric, words, now[name])
        innovation = now.get("innovation") or {}
        if innovation.get("ratio") is not None:
            yield _gauge("hil_innovation_ratio", "Innovation over what the model predicts, rms", innovation["ratio"])
        for name, (metric, words) in _COUNTS.items():
            if name in health:
                yield CounterMetricFamily(metric, words, value=health[name])
        if "turnaround_us" in health:
            turn = GaugeMetricFamily(
                "hil_turnaround_seconds", "From a sample's arrival to its answer, last second", labels=["quantile"]
            )
            for quantile, name in (("0.5", "p50"), ("0.99", "p99"), ("1", "max")):
                turn.add_metric([quantile], 1e-6 * health["turnaround_us"][name])
            yield turn


def _gauge(name: str, words: str, value: float | bool) -> Metric:
    return GaugeMetricFamily(name, words, value=float(value))
