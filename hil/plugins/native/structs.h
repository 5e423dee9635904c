/* What Python and the step of a plug-in share. hil/plugins/native/__init__.py reads it. */

#ifndef PLUGIN_STRUCTS_H
#define PLUGIN_STRUCTS_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "gyro_plugin.h"

typedef void (*observe_fn)(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate);
typedef void (*control_fn)(void *instance, const gyro_plugin_estimate *estimate, int drive_on, gyro_plugin_drive *drive);

typedef void (*trimmed_fn)(void *instance, const gyro_plugin_trims *trims);

/* Memory lent to a plug-in: `size` bytes at `at`, marked before and behind, with pages around that nobody may touch. */
typedef struct {
    uint8_t *pages; /* the first of them */
    int64_t length;
    uint8_t *at;
    int64_t size, room; /* what the marks behind it fill up */
} lent_t;

/* The bench's own estimator (estimator/core/core.c), for whichever part is not a plug-in's. */
typedef struct {
    void *estimator;
    void (*observe)(void *estimator, double vx, double vy, double ux, double uy);
    double (*passed)(void *estimator, double ux, double uy);
    void (*follow)(void *estimator, const double *x);
    void (*control)(void *estimator, double codes[2]);
    void (*commanded)(void *estimator, const double codes[2], double virtual_rate);
    void (*trimmed)(void *estimator, double *volts);
    const double *x;        /* scaled */
    const double *variance; /* scaled, (estimated, estimated) */
    const double *row;      /* the newest output */
    const double *factors;  /* SI of each entry of x */
    const int64_t *entries; /* of x, behind the rows of the covariance */
    int64_t estimated;
    double volts[2];        /* of a unit of length */
    double per_second;      /* scaled rate of 1 rad/s */
} own_t;

#define LENT 6 /* pieces of memory */

/* What the pattern showed, to count its turns. */
typedef struct {
    int64_t started;
    double theta, theta_zero, plain, plain_zero, virtual_turn, rate_integral;
} turned_t;

/* The newest motion, and for how many samples that differ from the one before it has been the same. */
typedef struct {
    double motion[4], sense_V[2];
    int64_t unchanged;
} held_t;

/* One plug-in, or two, in the place of the core's step. */
typedef struct {
    observe_fn observe; /* NULL: the bench's own */
    void *observer;
    trimmed_fn trimmed; /* of the observer; NULL: it is not told */
    control_fn control;
    void *controller;
    own_t own;

    /* what is handed over */
    gyro_plugin_sample *sample;
    gyro_plugin_estimate *estimate;
    gyro_plugin_drive *drive;
    gyro_plugin_trims *trims;
    lent_t lent[LENT]; /* instances of observer and controller, then the four above */

    /* where a plug-in's estimates go, SI: as the core's own row, state and covariance */
    double *row;
    double *state;
    double *variance; /* (states, states), the diagonal of it */
    const double *declared;
    int64_t states;
    turned_t turned;
    held_t held;

    gyro_plugin_device device;
    double step_s;
    int64_t code_limit;
    int64_t drive_on;
    int64_t number;   /* of the sample */
    int64_t limit_ns; /* that a call may take */
    int64_t begun_pages; /* of memory, when the run began; 0: not looked at */
    int64_t most_pages;  /* that may be added */

    /* entries of the state, a bit each: given so far, of them NaN later, and the first sample at which one was */
    uint64_t given, withdrawn;
    int64_t withdrawn_at;

    /* what is wrong: FAULT_… of PART_…, the entry and its value */
    int64_t fault, part, entry;
    double value;
    int64_t raised;  /* a plug-in in Python */
    int64_t *failed; /* of the caller; NULL for none */
} plugin_t;

enum { PART_NONE, PART_OBSERVE, PART_CONTROL, PARTS };

enum { FAULT_NONE, FAULT_RAISED, FAULT_LATE, FAULT_NUMBER, FAULT_BEYOND, FAULT_OVERRUN, FAULT_GROWN,
       FAULT_HELD, FAULT_ABSURD };

/* Entries that FAULT_NUMBER names, behind those of the state and of its deviations. */
enum { ENTRY_ANGLE = 2 * GYRO_PLUGIN_STATES, ENTRY_ANGLE_U, ENTRY_DRIVE_X, ENTRY_DRIVE_Y, ENTRY_VIRTUAL, ENTRY_INNOVATION_SD_X,
       ENTRY_INNOVATION_SD_Y };

#endif
