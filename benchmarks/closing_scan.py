"""What the scan that closes every run costs: from the record's file to its answer, kernels in their cache."""

import time

import numpy as np

from benchmarks.lockstep import bench_of, close_loop, scenario_of
from benchmarks.row import Row, Say
from estimator.completeness.closing import Limits, closing_scan
from estimator.completeness.stretch import Stretch, stretches_of
from estimator.record import Record
from estimator.settings import ControllerSettings
from hil.inputs.declared import device_of, observer_settings_of

CASES = (  # example, kS/s, seconds recorded, at most s
    ("s-slow", 24.0, 3.0),
    ("s-modern-5k", 60.0, 10.0),
)
_RECORDED = 200_000  # samples of a longer run that are made: the scan looks at no more


def rows(say: Say) -> list[Row]:
    """Seconds of processor and of wall time; the peer is what it may take."""
    figures = []
    for name, seconds, allowed in CASES:
        bench, scenario = bench_of(name), scenario_of(name)
        samples = round(seconds * scenario.board.sample_rate_Hz)
        made = min(samples, _RECORDED)
        run = close_loop(scenario, bench, made, seed=1, every=bench.loop.estimate_every)
        say(f"{name}: {made} samples recorded")
        volts = 2.0 * scenario.sense.adc_full_scale_V / 2**scenario.sense.adc_bits
        force = scenario.drive.full_scale_mps2 / 2 ** (scenario.drive.dac_bits - 1)
        step = np.full(made, 1.0 / run.sample_rate_Hz)
        record = Record(run.capture[:, 1:3] * volts, (run.capture[:, 3:5] * force)[:, :, None], step)
        controller = ControllerSettings(
            latency=scenario.drive.latency_samples, force_quantum=1.0, force_limit=1.0, sense_quantum=1.0,
            virtual_rotation=bench.controller.virtual_rotation_rad_s,
        )  # fmt: skip
        stretches = []
        for part in stretches_of(samples):
            begin = part.start * made // samples  # cost does not ask when the samples were taken
            at = slice(begin, begin + part.stop - part.start)
            stretches.append(Stretch(record.part(at), part.start / run.sample_rate_Hz, part.start == 0))
        took, busy = np.inf, np.inf
        for _ in range(3):  # the first has the caches to fill
            wall, processor = time.perf_counter(), time.process_time()
            found = closing_scan(
                stretches, device_of(bench), observer_settings_of(bench), controller,
                scored_s=(min(5.0, 0.2 * seconds), seconds), limits=Limits(0.1),
            )  # fmt: skip
            took, busy = min(took, time.perf_counter() - wall), min(busy, time.process_time() - processor)
        say(f"{name}: {found.outcome.value}, {found.reason}")
        figures.append(Row(f"{name}, {seconds:g} s: wall time", took, "s", "allowed", took / allowed))
        figures.append(Row(f"{name}, {seconds:g} s: processor", busy, "s", "allowed", busy / allowed))
    return figures
