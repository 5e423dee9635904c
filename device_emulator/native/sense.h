/* The sense chain: from the motion to codes (device_emulator/sense.py, device_emulator/effects/sense.py). */
#ifndef EMULATOR_SENSE_H
#define EMULATOR_SENSE_H

#include <math.h>
#include <stddef.h>

#include "structs.h"

#define TWO_PI 6.28318530717958647692

enum curve_kind { STRAIGHT, GAP_CLOSING, LENS, TUNNELLING };

/* What the two combs read of the motion: p = [x, ẋ, y, ẏ] with the effects. */
static inline void displacement(effects_t effects, const double *motion, double p[4])
{
    double x = motion[0], vx = motion[1], y = motion[2], vy = motion[3];
    p[0] = x;
    p[1] = vx;
    p[2] = y;
    p[3] = vy;
    for (int64_t n = 0; n < effects.count; n++) {
        const double *c = effects.first[n].c;
        const double *own = motion + effects.first[n].at;
        switch (effects.first[n].kind) {
        case SENSE_GAIN:
            p[0] += c[0] * x;
            p[1] += c[0] * vx;
            p[2] += c[1] * y;
            p[3] += c[1] * vy;
            break;
        case SENSE_CROSS_COUPLING:
            p[0] += c[0] * y;
            p[1] += c[0] * vy;
            p[2] += c[1] * x;
            p[3] += c[1] * vx;
            break;
        case SENSE_QUADRATIC:
            p[0] += c[0] * x * x;
            p[1] += 2.0 * c[0] * x * vx;
            p[2] += c[1] * y * y;
            p[3] += 2.0 * c[1] * y * vy;
            break;
        case SENSE_CUBIC:
            p[0] += c[0] * x * x * x;
            p[1] += 3.0 * c[0] * x * x * vx;
            p[2] += c[1] * y * y * y;
            p[3] += 3.0 * c[1] * y * y * vy;
            break;
        case SENSE_POLARITY:
            for (int axis = 0; axis < 2; axis++)
                if (c[axis] == 1.0) {
                    p[2 * axis] = -p[2 * axis];
                    p[2 * axis + 1] = -p[2 * axis + 1];
                }
            break;
        case PARASITIC_MODE:
            for (int i = 0; i < 4; i++)
                p[i] += own[i];
            break;
        default:
            break;
        }
    }
}

/* The displacement p = [x, ẋ, y, ẏ] that stands for what a readout with a curved characteristic shows, over its gain at
   rest, and how fast that changes. */
static inline void bent(const sense_t *sense, double p[4])
{
    double r2 = p[0] * p[0] + p[2] * p[2], dr2 = 2.0 * (p[0] * p[1] + p[2] * p[3]);
    for (int axis = 0; axis < 2 && sense->curve != STRAIGHT; axis++) {
        double c = sense->bend[axis], *q = p + 2 * axis;
        if (sense->curve == GAP_CLOSING) {
            double left = 1.0 - (q[0] / c) * (q[0] / c), shown = q[0] / left;
            q[1] *= (2.0 - left) / (left * left);
            q[0] = shown;
        } else if (sense->curve == LENS) {
            q[1] = q[1] * (1.0 + c * r2) + q[0] * c * dr2;
            q[0] *= 1.0 + c * r2;
        } else {
            q[1] *= exp(c * q[0]);
            q[0] = expm1(c * q[0]) / c;
        }
    }
}

/* Standard deviation of the white noise of a sample that shows `moved` over the gain at rest. */
static inline double noise_of(const sense_t *sense, int axis, double moved)
{
    if (sense->curve != TUNNELLING)
        return sense->noise_V;
    double grown = 1.0 + sense->bend[axis] * moved; /* of the current: exp(a x) */
    return sqrt(sense->noise_V * sense->noise_V + sense->shot_V2[axis] * (grown > 0.0 ? grown : 0.0));
}

/* Voltage that the effects add in the amplifiers, under the force u held up to the sampling instant. */
static inline void add_voltage(effects_t effects, double t_s, double warmer_K, const double u[2], const double *motion,
                               double v[2])
{
    v[0] = v[1] = 0.0;
    for (int64_t n = 0; n < effects.count; n++) {
        const double *c = effects.first[n].c;
        const double *own = motion + effects.first[n].at;
        switch (effects.first[n].kind) {
        case DRIVE_FEEDTHROUGH:
            v[0] += c[0] * u[0];
            v[1] += c[1] * u[1];
            break;
        case INTERFERENCE:
            v[0] += c[0] * sin(TWO_PI * c[2] * t_s + c[3]);
            v[1] += c[1] * sin(TWO_PI * c[2] * t_s + c[4]);
            break;
        case TEMPERATURE_OFFSET:
            v[0] += c[0] * warmer_K;
            v[1] += c[1] * warmer_K;
            break;
        case TELEGRAPH_OFFSET:
            v[0] += c[0] * own[0];
            v[1] += c[1] * own[1];
            break;
        case FREE_MODE:
            v[0] += own[0];
            v[1] += own[2];
            break;
        default:
            break;
        }
    }
}

/* What the amplifier of an axis puts out when `volts` are due. */
static inline double amplified(effects_t effects, int axis, double volts)
{
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == SENSE_CLIPPING)
            volts = within(volts, effects.first[n].c[axis]);
    return volts;
}

/* The code that a converter with flaws shows for `code`. */
static inline int64_t shown(effects_t effects, int64_t code)
{
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == MISSING_CODES) {
            int64_t beyond = modulo(code, (int64_t)effects.first[n].c[0]);
            if ((double)beyond < effects.first[n].c[1])
                code -= beyond;
        }
    return code;
}

/* A number in [0, 1) from a seed and a count (splitmix64: Steele, Lea & Flood, OOPSLA 2014). */
static inline double uniform(int64_t seed, int64_t number)
{
    uint64_t z = (uint64_t)seed + (uint64_t)number * UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    z ^= z >> 31;
    return ldexp((double)(z >> 11), -53);
}

/* Random telegraphs for one sample; they start at 1, modes that ring where they are told to. Whether one flips is
   hashed from seed and tick, so that they leave the noise as it is. */
static inline void flip(effects_t effects, int64_t seed, int64_t tick, double ts_s, double *motion)
{
    for (int64_t n = 0; n < effects.count; n++) {
        const double *c = effects.first[n].c;
        double *own = motion + effects.first[n].at;
        if (effects.first[n].kind == TELEGRAPH_OFFSET) {
            for (int axis = 0; axis < 2; axis++) {
                if (tick == 0)
                    own[axis] = 1.0;
                else if (uniform(seed, 2 * tick + axis) < -0.5 * expm1(-2.0 * c[2] * ts_s))
                    own[axis] *= -1.0;
            }
        } else if (effects.first[n].kind == FREE_MODE && tick == 0) {
            for (int axis = 0; axis < 2; axis++) {
                double beside = c[2 + 2 * axis], turned = c[3 + 2 * axis];
                own[2 * axis] = beside;
                own[2 * axis + 1] = c[0] * turned - 0.5 * c[1] * beside;
            }
        }
    }
}

/* Whether an axis shows the velocity itself, with no filter behind it. */
static inline bool shows_velocity(const sense_t *sense, int axis)
{
    return sense->current[axis] && sense->leak_per_s[axis] == 0.0;
}

/* What an axis shows of p, all but its gain, before tick 0: the board has been on, its layer has long swung, at the
   frequency of its stiffness.  A comb's charge has not leaked, and its low-pass is settled. */
static inline double shown_before(const sense_t *sense, const plant_t *plant, int axis, const double p[4])
{
    if (!sense->current[axis])
        return p[2 * axis];
    if (shows_velocity(sense, axis))
        return p[2 * axis + 1];
    double leak = sense->leak_per_s[axis], stiffness = axis == 0 ? plant->kxx : plant->kyy;
    return (leak * p[2 * axis + 1] + stiffness * p[2 * axis]) / (leak * leak + stiffness);
}

/* Release the chain at tick 0. */
static inline void start(const sense_t *sense, const plant_t *plant, effects_t effects, sense_state_t *state,
                         const double *motion)
{
    double p[4];
    displacement(effects, motion, p);
    bent(sense, p);
    for (int axis = 0; axis < 2; axis++) {
        bool moves = shows_velocity(sense, axis);
        state->seen[axis][0] = moves ? p[2 * axis + 1] : p[2 * axis];
        state->seen[axis][1] = moves ? 0.0 : p[2 * axis + 1];
        state->smooth[axis] = shown_before(sense, plant, axis, p);
        state->leaked[axis] = state->seen[axis][0] - state->smooth[axis];
    }
}

/* Carry filters and history, (rows, 2), over one sub-step that ended in `motion`. */
static inline void track(const sense_t *sense, effects_t effects, sense_state_t *state, double (*history)[2],
                         int64_t rows, const double *motion)
{
    double p[4];
    displacement(effects, motion, p);
    bent(sense, p);
    for (int axis = 0; axis < 2; axis++) {
        bool moves = shows_velocity(sense, axis); /* nothing is filtered then, and no slope is needed */
        double p0 = state->seen[axis][0], v0 = state->seen[axis][1];
        double p1 = moves ? p[2 * axis + 1] : p[2 * axis], v1 = moves ? 0.0 : p[2 * axis + 1];
        double leak = sense->leak_per_s[axis], leaked0 = state->leaked[axis];
        const double *w = sense->high_pass[axis];
        double leaked1 = w[0] * leaked0 + w[1] * p0 + w[2] * v0 + w[3] * p1 + w[4] * v1;
        double q0 = p0 - leaked0, qv0 = v0 - leak * (p0 - leaked0);
        double q1 = p1 - leaked1, qv1 = v1 - leak * (p1 - leaked1);
        w = sense->low_pass[axis];
        state->smooth[axis] = w[0] * state->smooth[axis] + w[1] * q0 + w[2] * qv0 + w[3] * q1 + w[4] * qv1;
        state->leaked[axis] = leaked1;
        state->seen[axis][0] = p1;
        state->seen[axis][1] = v1;
    }
    state->newest = modulo(state->newest + 1, rows);
    history[state->newest][0] = state->smooth[0];
    history[state->newest][1] = state->smooth[1];
}

/* The trajectory `back` sub-steps before the newest, by a polynomial through the nearest rows. */
static inline double delayed(double (*history)[2], int64_t rows, int64_t newest, int axis, double back)
{
    int64_t first = (int64_t)back - NODES / 2 + 1;
    if (first < 0)
        first = 0;
    double value = 0.0;
    for (int i = 0; i < NODES; i++) {
        double weight = 1.0;
        for (int j = 0; j < NODES; j++)
            if (j != i)
                weight *= (back - (double)(first + j)) / (i - j);
        value += weight * history[modulo(newest - first - i, rows)][axis];
    }
    return value;
}

/* Φ in V at the time t_s. */
static inline double offset(const sense_t *sense, const sense_state_t *state, double t_s, int axis)
{
    double left = exp(-sense->leak_per_s[axis] * t_s);
    double phi = sense->mismatch_V[axis] * left + sense->opamp_V[axis] * (1.0 + sense->opamp_gain[axis] * left);
    phi += sense->drift_V_per_s[axis] * t_s + state->random_walk[axis];
    for (int64_t pole = 0; pole < sense->flicker_poles; pole++)
        phi += state->flicker[axis][pole];
    return phi;
}

/* One sample of random walk and 1/f noise from 2 + 2 poles standard normals. `first` starts them: the random walk at
   zero, each 1/f process somewhere in its range. */
static inline void wander(const sense_t *sense, sense_state_t *state, const double *normals, bool first)
{
    for (int axis = 0; axis < 2; axis++) {
        if (!first)
            state->random_walk[axis] += sense->random_walk_V * normals[axis];
        for (int64_t pole = 0; pole < sense->flicker_poles; pole++) {
            double normal = normals[2 + axis * sense->flicker_poles + pole];
            double kept = sense->flicker_keep[pole] * state->flicker[axis][pole];
            state->flicker[axis][pole] =
                first ? sense->flicker_V[pole] * normal : kept + sense->flicker_add[pole] * normal;
        }
    }
}

/* The nearest code, the ends of the range held; whether they were goes into `clipped`. */
static inline int64_t convert(const sense_t *sense, double volts, bool *clipped)
{
    double code = rint(volts / sense->lsb_V);
    if (code > (double)sense->code_max) {
        *clipped = true;
        return sense->code_max;
    }
    if (code < (double)(-sense->code_max - 1)) {
        *clipped = true;
        return -sense->code_max - 1;
    }
    return (int64_t)code;
}

/* The code that goes out when the chain has a fault: the last one again, or one that went no further. */
static inline int64_t upset(const sense_t *sense, sense_state_t *state, int64_t tick, int axis, int64_t code)
{
    for (int64_t k = 0; k < sense->faults; k++)
        if (sense->fault_axis[k] == axis && sense->fault_first[k] <= tick && tick <= sense->fault_last[k]) {
            int64_t limit = sense->fault_limit[k];
            if (limit < 0)
                code = state->shown[axis];
            else
                code = code < -limit ? -limit : code > limit ? limit : code;
        }
    state->shown[axis] = code;
    return code;
}

#endif
