"""The bench's own estimator as a plug-in, as `hil generate` writes it, beside the one built in: cost of a sample.

Both answer the same samples by the function that the turn of the loop calls, one after the other in each round, in the
processor's time of this thread.
"""

import ctypes
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import hil
from benchmarks.row import Row, Say
from estimator.core.compiler import command
from estimator.observer import Observer
from hil.bench import load_bench, override
from hil.bench.examples import find
from hil.generating.c_code import golden
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.library.generating import assumed_board
from hil.plugins.of_bench import loop_observer

SAMPLES, QUIET, ROUNDS = 20_000, 200, 25
_TIMED = """
#include <stdint.h>
#include <time.h>
typedef void (*step_fn)(void *, double, double, double, double, double *);
double seconds(step_fn step, void *context, int64_t n, const int32_t *z, const int32_t *u)
{
    struct timespec begun, ended;
    double codes[2];
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begun);
    for (int64_t i = 0; i < 2 * n; i += 2)
        step(context, z[i], z[i + 1], u[i], u[i + 1], codes);
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &ended);
    return (double)(ended.tv_sec - begun.tv_sec) + 1e-9 * (double)(ended.tv_nsec - begun.tv_nsec);
}
"""


def rows(say: Say) -> list[Row]:
    """One row: a sample through the plug-in, over one through the core."""
    bench = override(load_bench(find("bench", "s-slow")), {"loop": {"clock": "lockstep"}}, "the benchmark")
    identity = assumed_board(bench, 1, None, None)

    def built_in() -> Observer:
        return Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))

    given = golden(built_in(), SAMPLES, QUIET)
    with tempfile.TemporaryDirectory() as aside:
        place = Path(aside)
        hil.generate(bench, out=place)
        subprocess.run(["make", "-s", "-C", place, "plugin"], check=True)
        (place / "timed.c").write_text(_TIMED)
        timer = place / "timed.so"
        subprocess.run([*command(), "-O2", "-shared", "-fPIC", "-o", timer, place / "timed.c"], check=True)
        seconds = ctypes.CDLL(str(timer)).seconds
        seconds.restype = ctypes.c_double
        seconds.argtypes = [*[ctypes.c_void_p] * 2, ctypes.c_int64, *[ctypes.c_void_p] * 2]
        name = str(place / "gyro_estimator.so")
        plugged = override(bench, {"observer": {"plugin": name}, "controller": {"plugin": name}}, "the benchmark")
        rounds = []
        for _ in range(ROUNDS):
            pair = []
            for observer in (built_in(), loop_observer(plugged, identity)):
                observer.enable_control(True)
                samples = SAMPLES, given.sense.ctypes.data, given.applied.ctypes.data
                pair.append(1e6 * seconds(observer.step, observer.core, *samples) / SAMPLES)
            rounds.append(pair)
    taken = np.array(rounds)
    own, theirs = np.median(taken, axis=0)
    row = Row.over("plug_in: step", float(theirs), "µs", "built in", taken[:, 1] / taken[:, 0])
    say(f"a sample through the generated plug-in {theirs:.2f} µs, built in {own:.2f} µs, ratio {row.ratio:.3f}")
    return [row]
