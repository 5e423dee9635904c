/* An estimator and controller for one gyro, as `hil generate` writes one, but simple: a fixed gain, declared constants.
 *
 * It stands here so that the example board can close its own loop. Put the folder of a generated one in its place:
 *
 *     make ESTIMATOR=FOLDER          with gyro_estimator.h and gyro_estimator.c in it
 */
#ifndef GYRO_ESTIMATOR_H
#define GYRO_ESTIMATOR_H

#include <stddef.h>
#include <stdint.h>

/* Of this interface. */
#define GYRO_ESTIMATOR_VERSION 2u

typedef double gyro_real;

#define GYRO_SAMPLE_RATE_HZ 4000.0 /* of the calls */
#define GYRO_LATENCY 1             /* samples from one to the interval in which the drive computed from it acts */
#define GYRO_SENSE_SCALE_V (0.25 / 32768.0)   /* volts of a sense code */
#define GYRO_DRIVE_SCALE_MPS2 (10.0 / 32768.0) /* force per mass of a drive code */

/* Entries of the state. */
enum { GYRO_X, GYRO_VX, GYRO_Y, GYRO_VY, GYRO_PHI_X, GYRO_PHI_Y, GYRO_RATE, GYRO_KXX, GYRO_KYY, GYRO_KXY, GYRO_DXX,
       GYRO_DYY, GYRO_DXY, GYRO_STATES };

/* All that it remembers. */
typedef struct gyro_estimator {
    gyro_real x[2], v[2]; /* m, m/s */
    gyro_real phi[2];     /* V */
    gyro_real rate;       /* rad/s */
    gyro_real pattern;    /* of the ellipse, within half a turn, rad */
    gyro_real angle;      /* rad, unwrapped */
    gyro_real energy;     /* over its set point */
    gyro_real quadrature; /* over the energy */
    unsigned long steps;
} gyro_estimator;

/* SI: m, m/s, V, rad/s, 1/s2, 1/s. A deviation below 0: declared, not estimated; 0: not told. */
typedef struct gyro_estimate {
    gyro_real state[GYRO_STATES];
    gyro_real deviation[GYRO_STATES];
    gyro_real angle_rad; /* since init, unwrapped */
    gyro_real angle_deviation_rad;
    int valid; /* the angle means something */
} gyro_estimate;

unsigned gyro_estimator_version(void);
size_t gyro_estimator_size(void);
void gyro_estimator_init(gyro_estimator *e);

/* The voltages sampled at tick m and the drive held over the interval that ends at m lead to the drive for the interval
 * that begins at m + latency, and to the angle. drive_on: whether that drive will be applied. */
void estimator_step(gyro_estimator *e, const gyro_real sense_V[2], const gyro_real applied_mps2[2], int drive_on,
                    gyro_real drive_mps2[2], double *angle_rad);

/* The same from codes to codes. */
void estimator_step_codes(gyro_estimator *e, const int32_t sense[2], const int32_t applied[2], int drive_on,
                          int32_t drive[2]);

/* What the last step estimated. */
void gyro_estimator_read(const gyro_estimator *e, gyro_estimate *out);

#endif
