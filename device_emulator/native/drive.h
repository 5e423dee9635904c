/* The drive chain: from codes to the force that acts (device_emulator/drive.py, device_emulator/effects/drive.py). */
#ifndef EMULATOR_DRIVE_H
#define EMULATOR_DRIVE_H

#include <math.h>

#include "structs.h"

typedef struct {
    double force, slope, until_s;
} acting_t;

/* Force per unit mass that reaches the mass when the converter puts out u. Delay and slew are the chain's own. */
static inline void reach(effects_t effects, double u[2])
{
    for (int64_t n = 0; n < effects.count; n++) {
        const double *c = effects.first[n].c;
        double ux = u[0], uy = u[1];
        switch (effects.first[n].kind) {
        case DRIVE_GAIN:
            u[0] = (1.0 + c[0]) * ux;
            u[1] = (1.0 + c[1]) * uy;
            break;
        case DRIVE_MISALIGNMENT:
            u[0] = ux + c[0] * uy;
            u[1] = uy + c[1] * ux;
            break;
        case DRIVE_SATURATION:
            u[0] = within(ux, c[0]);
            u[1] = within(uy, c[1]);
            break;
        case DRIVE_DEAD_BAND:
            u[0] = ux - within(ux, c[0]);
            u[1] = uy - within(uy, c[1]);
            break;
        case DRIVE_POLARITY:
            u[0] = c[0] == 1.0 ? -ux : ux;
            u[1] = c[1] == 1.0 ? -uy : uy;
            break;
        case ELECTROSTATIC_DRIVE:
            u[0] = ux + c[0] * ux * ux;
            u[1] = uy + c[1] * uy * uy;
            break;
        default:
            break;
        }
    }
}

/* Enter the force of the interval that ends at `row`. */
static inline void put_out(const drive_t *drive, effects_t effects, drive_state_t *state, int64_t row,
                           const int32_t codes[2])
{
    double u[2] = {codes[0] * drive->lsb_mps2, codes[1] * drive->lsb_mps2};
    reach(effects, u);
    int64_t this = modulo(row, RECENT), last = modulo(row - 1, RECENT);
    for (int axis = 0; axis < 2; axis++) {
        double target = u[axis], slew = drive->slew_mps3[axis];
        double start = state->recent[last][axis]; /* what an interval ends with the next one starts from */
        double far = target - start;
        if (fabs(far) > slew * drive->ts_s)
            target = start + copysign(slew * drive->ts_s, far);
        state->start[this][axis] = start;
        state->slope[this][axis] = isfinite(slew) && far != 0.0 ? copysign(slew, far) : 0.0;
        state->reach_s[this][axis] = fabs(target - start) / slew;
        state->recent[this][axis] = target;
    }
}

/* Force on one axis, its slope and until when, `since_s` after the start of the interval that ends at `row`;
   until when counts from that start, and the end of the interval is for the caller to see. */
static inline acting_t acting(const drive_t *drive, const drive_state_t *state, int64_t row, int axis, double since_s)
{
    double began = drive->delay_rest_s[axis]; /* of the command's interval, late by its delay */
    int64_t back = drive->delay_samples[axis];
    double until = INFINITY;
    if (since_s < began) {
        until = began;
        began -= drive->ts_s;
        back += 1;
    }
    int64_t place = modulo(row - back, RECENT);
    double reached = began + state->reach_s[place][axis];
    if (since_s < reached) {
        double slope = state->slope[place][axis];
        double force = state->start[place][axis] + slope * (since_s - began);
        return (acting_t){force, slope, reached < until ? reached : until};
    }
    return (acting_t){state->recent[place][axis], 0.0, until};
}

#endif
