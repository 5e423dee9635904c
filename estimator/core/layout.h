/* Numbers and records that the core shares: settings (written once), memory (carried from sample to sample), output (one
   row a sample).  layout.py reads them here (declared.py), and the loader compares their sizes.

   All numbers are scaled: time by 1/w0, length by the nominal amplitude.  `hil generate` gives smaller sizes and, for a
   board, real as float. */
#ifndef GYRO_LAYOUT_H
#define GYRO_LAYOUT_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef CORE_FLOAT32
typedef float real;
#define R(number) number##f
#define SQRT sqrtf
#define FABS fabsf
#define FLOOR floorf
#define CEIL ceilf
#define RINT rintf
#define SIN sinf
#define COS cosf
#define TANH tanhf
#define EXP expf
#define EXPM1 expm1f
#define LOG logf
#define POW powf
#define ATAN2 atan2f
#define HYPOT hypotf
#define INSTANT 1e-6f
#define ROUNDING 1e-6f
#else
typedef double real;
#define R(number) number
#define SQRT sqrt
#define FABS fabs
#define FLOOR floor
#define CEIL ceil
#define RINT rint
#define SIN sin
#define COS cos
#define TANH tanh
#define EXP exp
#define EXPM1 expm1
#define LOG log
#define POW pow
#define ATAN2 atan2
#define HYPOT hypot
#define INSTANT 1e-9   /* of an interval: short, and still something beside 1 */
#define ROUNDING 1e-12 /* of a difference between numbers of about 1 */
#endif

#ifdef CORE_INT32
typedef int32_t whole;
#else
typedef int64_t whole;
#endif

#define EXPORTED __attribute__((visibility("default"))) /* called from outside the library */

#define PI R(3.14159265358979323846)
#define HALF_TURN 3.14159265358979323846 /* in 64 bits, as all that grows with every turn */

#define MAX_AXES 2
#define BASE_CONSTANTS 9 /* of a two-axis gyro */
#ifndef MAX_LATENCY
#define MAX_LATENCY 15
#endif
#ifndef MAX_EFFECTS
#define MAX_EFFECTS 64 /* carried and watched */
#endif
#ifndef MAX_SIGNALS
#define MAX_SIGNALS 96
#endif
#ifndef MAX_SLIPS
#define MAX_SLIPS 4 /* signals that depend on the way */
#endif
#ifndef MAX_DEGREE
#define MAX_DEGREE 8 /* terms of a drive polynomial that are kept for a delay */
#endif
#ifndef MAX_DELAY
#define MAX_DELAY 8 /* samples */
#endif
#ifndef MAX_TERMS
#define MAX_TERMS 8 /* of the drive over an interval, as a polynomial */
#endif
#ifndef MAX_ENTRIES
#define MAX_ENTRIES (4 + BASE_CONSTANTS + 2 * MAX_EFFECTS) /* states and constants that are carried */
#endif
#define MAX_TRIMS 8
#define MAX_WIDTH ((MAX_ENTRIES + 3) / 4 * 4) /* of a row that fills vector registers */
#define MAX_COLUMNS MAX_WIDTH                 /* of a flow: the state, and its derivatives */

/* Order of the constants in the gyro's state vector. */
enum { PHI_X, PHI_Y, RATE, KXX, KYY, KXY, DXX, DYY, DXY };

typedef struct {
    whole model;
    whole states;
    whole sense_constants;
    whole flow_constants;
    whole axes;
    whole effect_count;
    whole effects[MAX_EFFECTS][3]; /* number, index of its first coefficient among the constants, of its first signal */
    whole candidate_count;         /* effects behind those that are watched and not carried */
    whole pushes;                  /* effects among them that are forces */
    whole kinked;                  /* a force depends on the direction of motion, or on the way */
    whole signal_count;
    whole carried_signals; /* those of effects that are carried, which come first */
    whole signals[MAX_SIGNALS][3];         /* source, its axis, index of its coefficient among the constants */
    real signal_parameters[MAX_SIGNALS][2]; /* a constant's value in the first */
    whole slip_count;
    whole slips[MAX_SLIPS][4]; /* signals that depend on the way: number, axis, index of the reach, source */
    whole sense_delay;         /* index of its first coefficient among the constants, -1 without */
    whole drive_delay;
    whole watched_sense_delay; /* the same of effects that are watched and not carried */
    whole watched_drive_delay;
    real h;                /* sample interval */
    whole order;           /* of the Taylor flow */
    real fade;             /* factor on the predicted covariance, 1 without fading */
    whole two_covariances; /* 1: the actual covariance C is carried beside P */
    whole resting;         /* 1: constants do not walk in C, whatever P allows for */
    whole stationary;      /* 1: gains from the table, no Riccati recursion from then on */
    real takeover;         /* time from which the table is used */
    whole sensed[MAX_AXES]; /* what a channel shows: 0 displacement, 1 velocity, 2 acceleration */
    real noise[MAX_AXES];   /* variance of the measurement */
    real ignored[MAX_AXES]; /* variance of what may be in it and is not estimated */
    real force_noise[MAX_AXES]; /* velocity variance per unit of time */
    /* controller */
    whole control;
    whole latency;
    real stiffness; /* target k */
    real energy;    /* target k A^2/2 */
    real energy_gain;
    real quadrature_gain;
    real virtual_rate;
    real reversal; /* time between reversals of the virtual rotation, 0: never */
    real dither;
    real modulation;
    real modulation_rate;
    real hold; /* sinc(w Ts/2), what the sample-and-hold leaves of a force */
    real force_limit;
    real quantum;               /* force of one drive code */
    real sense_scale[MAX_AXES]; /* position of one sense code */
    /* angle */
    real angular_gain; /* rotation of the pattern over that of the board */
    real reference;    /* time from which on the angle's uncertainty counts */
    whole open_loop;   /* 1: no drive makes the pattern an angle; it is the integrated rate */
    whole rate_row;    /* of the rate among states and active constants */
} Settings;

typedef struct {
    double time;
    whole cursor; /* which constant the regularised forgetting visits next */
    real nis;     /* smoothed normalised innovation squared, 1 when all is well */
    whole started;
    uint64_t dither; /* state of the xorshift generator */
    double theta;    /* pattern angle, unwrapped */
    double theta_zero;
    double theta_plain;
    double theta_plain_zero;
    real rotation; /* of the pattern against the board that theta was read with */
    real rate;     /* the estimated rate of the same */
    double forced; /* rotation of the pattern by forces */
    double rate_integral;
    double virtual_integral;
    real virtual_applied;
    real gradient[MAX_ENTRIES];    /* of the pattern angle by states and active constants: the rate alone */
    whole referred;                /* 1: the reference instant is past */
    real angle_variance;           /* of the pattern's rotation since then */
    real angle_cross[MAX_ENTRIES]; /* its covariance with states and active constants */
    real temperature;              /* above the first reading */
    real signals[MAX_SIGNALS][2];  /* value, and what else its recursion carries */
    real past[MAX_DELAY + 1][MAX_AXES][MAX_DEGREE]; /* drives of the intervals before, newest first */
    real queue[MAX_LATENCY + 1][3]; /* commanded ux, uy and the virtual rate in them, oldest first */
#ifdef CORE_FLOAT32
    real rest[MAX_ENTRIES]; /* of each state and constant: what its 32 bits do not hold */
#endif
} Memory;

typedef struct {
    real nu[MAX_AXES];   /* innovation */
    real s[MAX_AXES];    /* its predicted variance */
    double angle;        /* reported rotation, rad */
    real angle_variance; /* of the estimate, since the reference instant */
    double angle_forced; /* what was taken off for forces */
    double angle_pattern; /* what an ideal control would make equal to it */
    double angle_plain;   /* the same from the source's formula (11) */
    double angle_rate_integral;
    real energy_ratio;
    real quadrature_ratio;
} Output;

/* Trim electrodes of an observer.  softening: of kxx, kyy, kxy by V^2, and its variance; settling: time constant; target:
   voltage put out, volts: of the electrode, squared: that of which the square is in the constants by now.  rows: of kxx,
   kyy, kxy in the covariance, -1 for what is not estimated. */
typedef struct {
    whole count;
    whole rows[3];
    real softening[MAX_TRIMS][3];
    real variance[MAX_TRIMS][3];
    real settling[MAX_TRIMS];
    real target[MAX_TRIMS];
    real volts[MAX_TRIMS];
    real squared[MAX_TRIMS];
} Trims;

#endif
