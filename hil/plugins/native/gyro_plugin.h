/* An algorithm of one's own in the loop: an observer, a controller, or both, as a shared library.
 *
 * Compile it with  cc -O2 -shared -fPIC -o mine.so mine.c -lm  and name it in the bench file:
 *
 *     [observer]
 *     plugin = "mine.so"
 *     [controller]
 *     plugin = "mine.so"
 *
 * One that is named in both places has one instance, which does both. All units are SI, the drive a force per mass.
 */
#ifndef GYRO_PLUGIN_H
#define GYRO_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Of this interface. */
#define GYRO_PLUGIN_VERSION 1u

#if defined(_WIN32)
#define GYRO_PLUGIN_EXPORT __declspec(dllexport)
#else
#define GYRO_PLUGIN_EXPORT __attribute__((visibility("default")))
#endif

/* Entries of the state. Behind them stand the coefficients of [effects], in the order of estimates.arrow. */
enum {
    GYRO_PLUGIN_X, GYRO_PLUGIN_VX, GYRO_PLUGIN_Y, GYRO_PLUGIN_VY, GYRO_PLUGIN_PHI_X, GYRO_PLUGIN_PHI_Y, GYRO_PLUGIN_RATE,
    GYRO_PLUGIN_KXX, GYRO_PLUGIN_KYY, GYRO_PLUGIN_KXY, GYRO_PLUGIN_DXX, GYRO_PLUGIN_DYY, GYRO_PLUGIN_DXY
};
#define GYRO_PLUGIN_STATES 64

/* The device as the bench file declares it, and what its board says of its codes. */
typedef struct gyro_plugin_device {
    double sample_rate_Hz;
    double latency;              /* samples from one to the interval in which the drive computed from it acts */
    double mass_kg;
    double stiffness_per_s2[3];  /* kxx, kyy, kxy */
    double damping_per_s[3];     /* dxx, dyy, dxy */
    double target_stiffness_per_s2; /* of the controlled oscillator */
    double amplitude_m;          /* nominal, to be held */
    double sense_gain_V_per_m[2]; /* signed; V per m/s where sense_order is 1 */
    double sense_order;          /* 0: the displacement is sensed, 1: the velocity */
    double noise_V;              /* rms of a sense sample */
    double sense_scale_V;        /* of a sense code */
    double drive_scale_mps2;     /* of a drive code */
    double drive_limit_mps2;     /* no drive may be larger, on either axis */
    double angular_gain;         /* rotation of the pattern over that of the board */
    double virtual_rotation_rad_s; /* [controller] virtual_rotation_rad_s, for the controller to impose */
    double virtual_reversal_s;     /* and to reverse so often, the first time after half of it; 0: never */
} gyro_plugin_device;

/* One sample. */
typedef struct gyro_plugin_sample {
    int64_t number;           /* 0 for the first */
    double sense_V[2];        /* NaN: lost */
    double applied_mps2[2];   /* held over the interval that ends at the sample */
    double virtual_rotation_rad_s; /* that the controller imposed by it, with the sign of a rate: the azimuth of the pattern
                                      turns by minus it; no turn of the board */
    int32_t sense_codes[2];   /* the same in codes; 0 of a lost one */
    int32_t applied_codes[2];
    int32_t lost;
    int32_t reserved;
    double quadrature_V[2];   /* of demodulated streams, see below, whose in-phase parts are then above; else 0 */
    double applied_quadrature_mps2[2];
} gyro_plugin_sample;

/* What an observer makes of it. Every number is NaN when gyro_plugin_observe is called. What it must fill: angle_rad,
 * and of the state X, VX, Y, VY and RATE. The rest may stay: a constant is then the declared one, an uncertainty is
 * told as missing, and the bench works out what follows from the state. */
typedef struct gyro_plugin_estimate {
    double angle_rad;     /* rotation since the first sample, +integral of the rate, unwrapped; what the drive turned is
                             taken off */
    double angle_u_rad;   /* its standard uncertainty, k = 1 */
    double innovation_V[2]; /* measured less predicted from the samples before */
    double innovation_deviation_V[2];
    double energy_ratio;     /* energy of the vibration over its set point */
    double quadrature_ratio; /* sqrt(k) (x vy - y vx) / energy */
    double angle_forced_rad;    /* what was taken off of the angle for the drive */
    double angle_pattern_rad;   /* of the pattern, with the virtual rotation alone taken off */
    double angle_plain_rad;     /* the same by the plain formula (11) */
    double rate_integral_rad;
    double state[GYRO_PLUGIN_STATES];     /* m, m/s; V; rad/s; 1/s2; 1/s */
    double deviation[GYRO_PLUGIN_STATES]; /* standard, the same units; 0: taken as declared, not estimated */
} gyro_plugin_estimate;

/* What a controller asks for. */
typedef struct gyro_plugin_drive {
    double force_mps2[2];          /* for the interval `latency` samples on; rounded to codes by the bench */
    double virtual_rotation_rad_s; /* of the pattern by this force, for the bench's own observer to take off; 0 to begin */
} gyro_plugin_drive;

/* GYRO_PLUGIN_VERSION, as compiled. */
GYRO_PLUGIN_EXPORT unsigned gyro_plugin_version(void);

/* Bytes of an instance. The bench gives it that much memory, zeroed and aligned to 64 bytes. */
GYRO_PLUGIN_EXPORT size_t gyro_plugin_size(void);

/* Begin. NULL, or one line that says why this device cannot be taken. */
GYRO_PLUGIN_EXPORT const char *gyro_plugin_init(void *instance, const gyro_plugin_device *device);

/* An observer: called at every sample, in order. */
GYRO_PLUGIN_EXPORT void gyro_plugin_observe(void *instance, const gyro_plugin_sample *sample,
                                            gyro_plugin_estimate *estimate);

/* A controller: called behind it, with that estimate, in which constants that were left out are the declared ones, or
 * with the one of the bench's own observer; NaN where there is no uncertainty. drive_on: whether the drive will be applied; without, it is zero. */
GYRO_PLUGIN_EXPORT void gyro_plugin_control(void *instance, const gyro_plugin_estimate *estimate, int drive_on,
                                            gyro_plugin_drive *drive);

/* What a plug-in may have beside these. */

/* A named number of its own, from the bench file, before init; 0: it has none of that name. carrier_Hz: its samples are
 * rows of demodulated streams: X in phase and Y in quadrature of X cos wt - Y sin wt, w = 2 pi carrier_Hz, t = 0 at the
 * first row; noise_V is then that of X, and of Y. */
GYRO_PLUGIN_EXPORT int gyro_plugin_option(void *instance, const char *name, double value);

/* Why it cannot go on, one line, asked for where its estimate's angle is not finite; NULL: it does not say. */
GYRO_PLUGIN_EXPORT const char *gyro_plugin_why(const void *instance);

#define GYRO_PLUGIN_TRIMS 8

/* Trim electrodes of the board that the bench file declares, and the voltages that act: known input of an observer. */
typedef struct gyro_plugin_trims {
    int64_t count;
    double volts[GYRO_PLUGIN_TRIMS];       /* in the middle of the interval that ends at the sample, as they settle */
    double softening_per_s2_per_V2[GYRO_PLUGIN_TRIMS][3]; /* that V2 takes off of kxx, kyy, kxy, as declared */
    double softening_u_per_s2_per_V2[GYRO_PLUGIN_TRIMS][3]; /* its standard uncertainty */
    double settling_s[GYRO_PLUGIN_TRIMS];  /* time constant by which a voltage follows its output */
    double softened_per_s2[3];             /* what all of them take off of kxx, kyy, kxy now */
} gyro_plugin_trims;

/* An observer's, called before gyro_plugin_observe: at the first sample, and wherever a voltage has changed. Without it
 * a bench file with [trim] electrodes is refused. */
GYRO_PLUGIN_EXPORT void gyro_plugin_trimmed(void *instance, const gyro_plugin_trims *trims);

/* A figure of its own, for the result and the report. */
typedef struct gyro_plugin_named {
    const char *name, *unit; /* up to 31 and 15 characters */
    double value, limit;     /* NaN: without one */
} gyro_plugin_named;

/* Figure number 0, 1, ... at the end of a run; 0 behind the last. */
GYRO_PLUGIN_EXPORT int gyro_plugin_figure(const void *instance, int number, gyro_plugin_named *figure);

#ifdef __cplusplus
}
#endif

#endif
