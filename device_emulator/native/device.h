/* The gyro itself: drive chain, plant and sense chain, row by row (device_emulator/device.py).

   Shares no line with the estimator's core: the same mistake on both sides would cancel. */
#ifndef EMULATOR_DEVICE_H
#define EMULATOR_DEVICE_H

#include "drive.h"
#include "play.h"

#define PAGE 64 /* rows for which noise is drawn at a time */

/* What one call works on; filled by device_emulator/device.py. */
typedef struct {
    const constants_t *constants;
    const effect_t *effects;
    int64_t effect_count;
    const piece_t *pieces;
    int64_t piece_count;
    state_t *state;
    double (*history)[2];
    int64_t history_rows;
    const double *noise; /* (PAGE, noise_columns) standard normals */
    int64_t noise_columns;
    int32_t (*drive_codes)[2]; /* (PAGE, 2), like all below */
    int32_t (*sense_codes)[2];
    double (*truth)[11];
} device_t;

/* Seconds from t0 to the next piece of the rate profile. */
static double next_change(const device_t *device, double t0)
{
    int64_t next = device->state->piece + 1;
    return next < device->piece_count ? device->pieces[next].start_s - t0 : INFINITY;
}

/* The electrodes settle on over h seconds: K of the plant as it is in the middle of them. */
static void soften(const plant_t *plant, state_t *state, double h, plant_t *softer)
{
    *softer = *plant;
    for (int64_t k = 0; k < plant->trim.count; k++) {
        const double *c = plant->trim.softening[k], settling_s = plant->trim.settling_s[k];
        double away = state->trim_V[k] - state->trim_target_V[k];
        double half = settling_s > 0.0 ? exp(-0.5 * h / settling_s) : 0.0;
        double volts = state->trim_target_V[k] + away * half;
        softer->kxx -= c[0] * volts * volts;
        softer->kyy -= c[1] * volts * volts;
        softer->kxy -= c[2] * volts * volts;
        state->trim_V[k] = state->trim_target_V[k] + away * half * half;
    }
}

/* The mass from `since` to `until` seconds after t0, between which neither drive nor rate profile changes. */
static void carry(const device_t *device, effects_t effects, double t0, double since, double until, push_t *push)
{
    const plant_t *plant = &device->constants->plant;
    plant_t softer;
    if (plant->trim.count > 0) {
        soften(plant, device->state, until - since, &softer);
        plant = &softer;
    }
    const piece_t *piece = &device->pieces[device->state->piece];
    double *motion = device->state->motion;
    if (effects.count == 0) {
        step_alone(plant, piece, t0 + since, until - since, push, motion);
        return;
    }
    int64_t count = parts(plant, effects, piece, t0 + since, until - since, push, motion);
    double h = (until - since) / (double)count;
    bool playing = has_play(effects);
    for (int64_t part = 0; part < count; part++) {
        double at = t0 + (since + (double)part * h);
        if (playing)
            step_with_play(plant, effects, piece, at, h, push, (int)plant->states, motion);
        else
            step(plant, effects, piece, at, h, push, (int)plant->states, motion);
        push->u[0] += h * push->slope[0];
        push->u[1] += h * push->slope[1];
    }
}

/* One sample interval of the mass; sub-steps are cut where the drive or the rate profile changes. */
static void interval(const device_t *device, effects_t effects, const double *normals)
{
    const plant_t *plant = &device->constants->plant;
    const drive_t *drive = &device->constants->drive;
    const sense_t *sense = &device->constants->sense;
    state_t *state = device->state;
    int64_t row = state->tick + 1;
    double t0 = (double)state->tick * plant->ts_s, h = plant->ts_s / (double)plant->substeps;
    double changes = next_change(device, t0), felt = coriolis(effects), light = lightness(effects);
    for (int64_t k = 0; k < plant->substeps; k++) {
        double fx = plant->noise_xx * normals[2 * k] + state->drive.flickering[0];
        double fy = plant->noise_yx * normals[2 * k] + plant->noise_yy * normals[2 * k + 1];
        fy += state->drive.flickering[1];
        double since = (double)k * h, end = (double)(k + 1) * h;
        while (since < end) {
            double until = fmin(end, changes);
            push_t push = {.noise = {fx, light * fy}, .drift_rad_s = state->drift_rad_s};
            for (int axis = 0; axis < 2; axis++) {
                acting_t now = acting(drive, &state->drive, row, axis, since);
                push.u[axis] = now.force;
                push.slope[axis] = now.slope;
                until = fmin(until, now.until_s);
            }
            carry(device, effects, t0, since, until, &push);
            since = until;
            /* A change that rounding leaves just past the end of the interval belongs to its end. */
            while (changes <= since * (1.0 + 1e-9)) {
                double before = rate_at(&device->pieces[state->piece], t0 + changes).rate_rad_s;
                state->piece++;
                double jump = felt * (rate_at(&device->pieces[state->piece], t0 + changes).rate_rad_s - before);
                state->motion[1] += jump * state->motion[2];
                state->motion[3] -= light * jump * state->motion[0];
                changes = next_change(device, t0);
            }
        }
        if (sense->tracked)
            track(sense, effects, &state->sense, device->history, device->history_rows, state->motion);
    }
}

/* Fill the history with the undriven motion before tick 0, so that a delay finds something to show. States of the
   effects' own stay: they begin at tick 0. */
static void rewind_history(const device_t *device, effects_t effects)
{
    const plant_t *plant = &device->constants->plant;
    double motion[STATES], seen[4], h = plant->ts_s / (double)plant->substeps;
    push_t rest = {.drift_rad_s = 0.0};
    int64_t rows = device->history_rows;
    memcpy(motion, device->state->motion, sizeof motion);
    for (int64_t back = 0; back < rows; back++) {
        displacement(effects, motion, seen);
        bent(&device->constants->sense, seen);
        for (int axis = 0; axis < 2; axis++)
            device->history[rows - 1 - back][axis] = shown_before(&device->constants->sense, plant, axis, seen);
        step(plant, effects, device->pieces, -(double)back * h, -h, &rest, 4, motion);
    }
    device->state->sense.newest = rows - 1;
}

/* Codes and truth of the row at `state->tick`, whose motion is known. */
static bool sample(const device_t *device, effects_t effects, int64_t row, const double *normals, bool begins)
{
    const plant_t *plant = &device->constants->plant;
    const sense_t *sense = &device->constants->sense;
    state_t *state = device->state;
    double t = (double)state->tick * plant->ts_s;
    wander(sense, &state->sense, normals + 2, begins);
    const piece_t *piece = &device->pieces[state->piece];
    double lsb = device->constants->drive.lsb_mps2;
    double u[2] = {device->drive_codes[row][0] * lsb, device->drive_codes[row][1] * lsb}, added[2], seen[4];
    double warmer_K = warmer(&plant->temperature, t);
    add_voltage(effects, t, warmer_K, u, state->motion, added);
    displacement(effects, state->motion, seen);
    bent(sense, seen);
    double *truth = device->truth[row];
    bool clipped = false;
    for (int axis = 0; axis < 2; axis++) {
        double moved = seen[2 * axis + shows_velocity(sense, axis)]; /* nothing is filtered */
        if (sense->tracked)
            moved = delayed(device->history, device->history_rows, state->sense.newest, axis, sense->delay_substeps[axis]);
        double phi = offset(sense, &state->sense, t, axis);
        double gain = sense->gain_V_per_m[axis] * (1.0 + sense->tempco_per_K[axis] * warmer_K);
        double volts = amplified(effects, axis, gain * moved + phi + added[axis]);
        int64_t code = shown(effects, convert(sense, volts + noise_of(sense, axis, moved) * normals[axis], &clipped));
        device->sense_codes[row][axis] = (int32_t)upset(sense, &state->sense, state->tick, axis, code);
        truth[4 + axis] = phi;
    }
    memcpy(truth, state->motion, 4 * sizeof *truth);
    truth[6] = rate_at(piece, t).rate_rad_s;
    truth[7] = angle_at(piece, t);
    truth[8] = plant->kxx;
    truth[9] = plant->kyy;
    truth[10] = plant->kxy;
    for (int64_t k = 0; k < plant->trim.count; k++)
        for (int entry = 0; entry < 3; entry++)
            truth[8 + entry] -= plant->trim.softening[k][entry] * state->trim_V[k] * state->trim_V[k];
    return clipped;
}

/* Drive and bias wander on, from the last columns of the row's noise. */
static void wander_on(const device_t *device, const double *normals, bool begins)
{
    const flicker_t *drive = &device->constants->drive.flicker, *bias = &device->constants->plant.flicker;
    const double *last = normals + device->noise_columns - 2 * drive->poles - bias->poles;
    state_t *state = device->state;
    for (int axis = 0; axis < 2; axis++)
        state->drive.flickering[axis] = flickered(drive, state->drive.flicker[axis], last + axis * drive->poles, begins);
    state->drift_rad_s = flickered(bias, state->flicker, last + 2 * drive->poles, begins);
}

/* Produce n rows of the page from row `first` on; whether the converter clipped. */
static bool advance(const device_t *device, int64_t first, int64_t n)
{
    const constants_t *constants = device->constants;
    const effects_t effects = {device->effects, device->effect_count};
    state_t *state = device->state;
    bool clipped = false;
    for (int64_t row = first; row < first + n; row++) {
        const double *normals = device->noise + row * device->noise_columns;
        bool begins = state->tick < 0;
        wander_on(device, normals, begins);
        flip(effects, state->seed, state->tick + 1, constants->plant.ts_s, state->motion);
        if (begins) {
            start(&constants->sense, &constants->plant, effects, &state->sense, state->motion);
            put_feet(effects, state->motion);
            rewind_history(device, effects);
        } else {
            put_out(&constants->drive, effects, &state->drive, state->tick + 1, device->drive_codes[row]);
            interval(device, effects, normals);
        }
        state->tick++;
        clipped |= sample(device, effects, row, normals + 2 * constants->plant.substeps, begins);
    }
    return clipped;
}

#endif
