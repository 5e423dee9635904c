/* A loop's gain at one frequency, measured while it is closed: a small sine is added to what its filter asks for. */

#ifndef CLASSIC_PROBE_H
#define CLASSIC_PROBE_H

#include <complex.h>
#include <math.h>
#include <stdint.h>

#define SETTLING_CYCLES 5

/* Which loop, at which frequency, how large, and the sums of what the filter asked for and of what went in: running, and
   over whole cycles. */
typedef struct {
    int64_t loop; /* 0: none, until `live` */
    double step_rad, size, phase;
    int64_t live, cycles;
    double complex asked, sent, whole_asked, whole_sent;
} loop_probe;

/* `asked` of a loop with the sine added where it is the probed one, taken into the sums. */
static double probed(loop_probe *probe, int64_t loop, double asked, double unit)
{
    if (probe->loop != loop || !probe->live)
        return asked;
    double sent = asked + probe->size * unit * cos(probe->phase);
    double complex turned = cexp(-I * probe->phase);
    probe->asked += asked * turned;
    probe->sent += sent * turned;
    probe->phase += probe->step_rad;
    if (probe->phase >= 2.0 * HALF_TURN) {
        probe->phase -= 2.0 * HALF_TURN;
        if (++probe->cycles == SETTLING_CYCLES)
            probe->asked = probe->sent = 0.0;
        probe->whole_asked = probe->asked;
        probe->whole_sent = probe->sent;
    }
    return sent;
}

/* The open loop's gain, as a complex number; 0 before anything was measured. */
static double complex loop_gain(const loop_probe *probe)
{
    return cabs(probe->whole_sent) > 0.0 ? -probe->whole_asked / probe->whole_sent : 0.0;
}

#endif
