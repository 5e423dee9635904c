/* @TITLE@
 *
 * Written by `hil generate` of gyrohil @PRODUCT@ from @BENCH@; not to be edited: change the bench file and write it again.
 *
 * C99, without allocation or global variables. All that changes from sample to sample is in one struct, which may be
 * copied as it is. @REAL@
 *
 *     static gyro_estimator estimator;
 *     gyro_estimator_init(&estimator);
 *     at every sample:  estimator_step(&estimator, sense_V, applied_mps2, drive_on, drive_mps2, &angle_rad);
 *
 * One call a sample, without exception: each call moves the model on by one period of GYRO_SAMPLE_RATE_HZ. Where there is
 * no sample, call with NaN, or with GYRO_MISSING in codes; each axis may be missing by itself. Where a call is left out
 * instead, the estimate lags behind the device by a sample: of the example s-slow the angle was then off by up to 0.05 rad,
 * 0.03 rad of it stayed, and the stated deviation was less than half of that.
 *
 * Pass NaN or GYRO_MISSING, too, for a sample at either end of the converter's range, and for a channel that you know to
 * be stuck. The estimator cannot tell them from a signal: the angle would be wrong while `valid` is 1.
 *
 * A drive applied that is NaN, infinite or GYRO_MISSING is taken for the one that the controller asked for. Any other
 * number is believed. A voltage or drive of absurd size can make the state not finite, for good: then the angle is not
 * finite and `valid` is 0; call gyro_estimator_init again.
 *
 * drive_on: 0 for the first GYRO_ACQUISITION_SAMPLES samples after gyro_estimator_init, and while no drive is applied.
 */
#ifndef GYRO_ESTIMATOR_H
#define GYRO_ESTIMATOR_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Of this interface. */
#define GYRO_ESTIMATOR_VERSION @VERSION@u

typedef @TYPE@ gyro_real;
typedef int32_t gyro_whole;

#define GYRO_SAMPLE_RATE_HZ @SAMPLE_RATE@ /* of the calls */
#define GYRO_LATENCY @LATENCY@           /* samples from one to the interval in which the drive computed from it acts */
#define GYRO_SENSE_SCALE_V @SENSE_SCALE@ /* volts of a sense code */
#define GYRO_DRIVE_SCALE_MPS2 @DRIVE_SCALE@ /* force per mass of a drive code, m/s2 */
#define GYRO_DRIVE_LIMIT_MPS2 @DRIVE_LIMIT@ /* no drive is larger */
#define GYRO_ACQUISITION_SAMPLES @ACQUISITION@ /* without drive, until the observer has found the motion: acquisition_s */
#define GYRO_MISSING INT32_MIN /* a sense code or an applied code that there is not */

/* Entries of the state. */
enum { GYRO_X, GYRO_VX, GYRO_Y, GYRO_VY, GYRO_PHI_X, GYRO_PHI_Y, GYRO_RATE, GYRO_KXX, GYRO_KYY, GYRO_KXY, GYRO_DXX,
       GYRO_DYY, GYRO_DXY@COEFFICIENT_NAMES@, GYRO_STATES };

/* Private, scaled: time by the resonance, length by the amplitude. */
@STRUCTS@
typedef struct gyro_estimator {
    gyro_real p[@COVARIANCE@]; /* first: rows of whole vectors, where the instance is aligned to one */
@SECOND@    gyro_workspace work;
    gyro_memory memory;
    gyro_output row;
    gyro_real x[@TOTAL@];
} gyro_estimator;

/* SI. A deviation below 0: declared, not estimated. */
typedef struct gyro_estimate {
    gyro_real state[GYRO_STATES];     /* @UNITS@ */
    gyro_real deviation[GYRO_STATES]; /* standard deviations, the same units */
    gyro_real innovation_V[2];        /* measured less predicted, of the last sample */
    gyro_real innovation_deviation_V[2];
    double angle_rad;           /* rotation since the start, unwrapped; the turn that forces caused is taken off */
    gyro_real angle_deviation_rad; /* by estimation alone, since @REFERENCE@ s */
    gyro_real energy_ratio;        /* energy of the vibration over its set point */
    gyro_real quadrature_ratio;    /* quadrature over the energy */
    int valid;                     /* both within the limits of the bench file: the angle means something, if what was
                                      passed was what the converters saw */
} gyro_estimate;

/* GYRO_ESTIMATOR_VERSION and sizeof (gyro_estimator) of what was compiled: both must be the caller's. */
unsigned gyro_estimator_version(void);
size_t gyro_estimator_size(void);

void gyro_estimator_init(gyro_estimator *estimator);

/* The observer: sense_V sampled at tick m (NaN: none), applied_mps2 held over the interval that ends at m (NaN: as asked). */
void observer_step(gyro_estimator *estimator, const gyro_real sense_V[2], const gyro_real applied_mps2[2]);

/* The controller: the drive for the interval that begins at m + GYRO_LATENCY, in whole codes of GYRO_DRIVE_SCALE_MPS2
 * and within the limit. drive_on: whether it will be applied; without, it is zero. */
void controller_step(gyro_estimator *estimator, int drive_on, gyro_real drive_mps2[2]);

/* The two, and the angle. */
void estimator_step(gyro_estimator *estimator, const gyro_real sense_V[2], const gyro_real applied_mps2[2],
                    int drive_on, gyro_real drive_mps2[2], double *angle_rad);

/* The same from codes to codes; this is what the bench computes in its loop, to the last bit where gyro_real is double. */
void estimator_step_codes(gyro_estimator *estimator, const int32_t sense[2], const int32_t applied[2], int drive_on,
                          int32_t drive[2]);

/* What the last step estimated. */
void gyro_estimator_read(const gyro_estimator *estimator, gyro_estimate *estimate);

#ifdef __cplusplus
}
#endif

#endif
