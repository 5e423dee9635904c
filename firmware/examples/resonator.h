/* A mass on two springs that rotates at a constant rate: what the example board measures and drives.
 *
 *     x'' + dxx x' + dxy y' + kxx x + kxy y = ux + 2 W y' + W^2 x
 *     y'' + dxy x' + dyy y' + kxy x + kyy y = uy - 2 W x' + W^2 y
 *
 * All per unit mass. Between two samples the drive is constant and everything is linear, so one step is one
 * product with the exponential of the system's matrix, computed once: exact, whatever the sampling rate.
 */
#ifndef RESONATOR_H
#define RESONATOR_H

#include "hil_spec.h"

#include <stdint.h>

typedef struct resonator_device {
    double sample_rate_Hz;
    double stiffness_per_s2[3]; /* kxx, kyy, kxy */
    double damping_per_s[3];    /* dxx, dyy, dxy */
    double rate_rad_s;
    double start_m;
    double gain_V_per_m;
    double offset_V[2];
    double noise_V;
    unsigned sense_bits;
    double sense_full_scale_V;
    unsigned drive_bits;
    double drive_full_scale_mps2;
} resonator_device;

/* 200 Hz at 4 kS/s. */
extern const resonator_device resonator_slow;
/* 5 kHz at 100 kS/s, for gain mode. */
extern const resonator_device resonator_fast;

typedef struct resonator {
    const resonator_device *device;
    double step[4][6]; /* from x, x', y, y', ux, uy to the next x, x', y, y' */
    double state[4];
    uint64_t noise;
} resonator;

void resonator_init(resonator *r, const resonator_device *device, uint64_t seed);

/* The springs, or the rate, are others from now on; the motion goes on. */
void resonator_retune(resonator *r, const resonator_device *device);

/* One sample interval under drive codes held. */
void resonator_step(resonator *r, int32_t ux, int32_t uy);

/* Convert both axes; returns whether the converter clipped. */
int resonator_sense(resonator *r, int32_t *vx, int32_t *vy);

/* What a board that measures and drives it tells of itself. */
hil_identity resonator_identity(const resonator_device *device, uint64_t unique_id, uint16_t latency_ticks);

double resonator_sense_scale_V(const resonator_device *device);
double resonator_drive_scale_mps2(const resonator_device *device);

#endif
