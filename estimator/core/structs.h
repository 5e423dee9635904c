/* What functions of the core hand to one another.  Matrices are rows after rows, of so many numbers as is told. */
#ifndef GYRO_STRUCTS_H
#define GYRO_STRUCTS_H

#include "layout.h"

#define MOST_TERMS 60 /* of a Taylor series */
#define LENGTHS 4     /* of a drift: those of the second half are those of the first */
#define OF_A_LENGTH 80

/* An observer, scaled: its arrays are its owner's.

   active (count,) which constants are estimated, n states and constants together; of each such constant the intensity of
   its random walk, the square of the density: variance per unit of time; prior: variance with which the initial value is
   measured again for what was forgotten of it, 0 for none; spread: its initial variance; initial value.  table (angles,
   phases, n, axes) the stationary gains; x (total,) states and all constants; p (n, width) the covariance that the gain
   assumes, c the one that the estimates have under it, the same where there is one; rows the newest output. */
typedef struct {
    whole count;
    whole n;
    whole width;
    whole total;
    whole angles;
    whole phases;
    const Settings *settings;
    Memory *memory;
    Output *rows;
    const whole *active;
    const real *intensity;
    const real *prior;
    const real *spread;
    real *initial;
    const real *table;
    real *x;
    real *p;
    real *c;
    Trims *trims;
} Observer;

/* z (axes,) what was measured, NaN where nothing was; u (axes, terms) the drive over the interval of length h that ends
   there. */
typedef struct {
    const real *z;
    const real *u;
    whole terms;
    real h;
} Sample;

/* A stretch of time: where it begins, its length, and the drive u (axes, terms) in it as a polynomial in normalised
   time. */
typedef struct {
    double time;
    real h;
    const real *u;
    whole terms;
} Interval;

/* Sum of the effects' forces with its derivatives by_states (axes, states) and by_constants (axes, constants); what they
   depend on: drive, and signals, values and derivatives by the velocity.

   slips: signals that depend on the way, in the columns of the flow; their place in the second half of signals has the
   derivative of the force by them. */
typedef struct {
    whole constants;
    real force[MAX_AXES];
    real by_states[MAX_AXES * 4];
    real by_constants[MAX_AXES * (MAX_COLUMNS + 4)];
    real drive[MAX_AXES];
    real signals[2 * MAX_SIGNALS];
    real slips[MAX_SLIPS][MAX_COLUMNS];
} Push;

/* Result and scratch of a flow: out, columns [state | by the state | by flow and effect constants] (states, columns) of
   what is advanced; term of the Taylor series and other, of its shape, are scratch; push what the effects do.  Of two
   axes: powers (orders, 16), the terms of exp(M h); drifts (LENGTHS, OF_A_LENGTH), as `drift_matrices` leaves them;
   entries (4, 8), what a unit of each state added to the force of each axis does to the states. */
typedef struct {
    real term[4 * MAX_COLUMNS];
    real other[4 * MAX_COLUMNS];
    real out[4 * MAX_COLUMNS];
    whole columns;
    Push push;
    real powers[(MOST_TERMS + 1) * 16];
    real drifts[LENGTHS * OF_A_LENGTH];
    real entries[4 * 8];
#ifdef CORE_FLOAT32
    real rest[MAX_ENTRIES]; /* of the state in out's first column, and of the constants: as in Memory */
#endif
} FlowWork;

/* Scratch of one observer of n states and active constants, `total` with all constants that are carried.

   transition (n, states) the states' rows of the Jacobian, turned; rows (2 states, width) and projected (4, width) of
   covariances; jacobian (2, n) of the measurement, full (2, total) by all constants; gain (n, 2); jump what a constant's
   jump does; per axis: predicted measurement, its noise, the noise that the gain assumes, innovation, its variance;
   shared: what the second innovation is expected to be when the first is one deviation, deviation: of the first, and of
   the second when the first is known. */
typedef struct {
    FlowWork flow; /* first: its rows begin where those of vector registers may */
    whole n;
    whole total;
    real transition[MAX_ENTRIES * 4];
    real rows[8 * MAX_WIDTH];
    real projected[4 * MAX_WIDTH];
    real jacobian[MAX_AXES * MAX_ENTRIES];
    real full[MAX_AXES * MAX_ENTRIES];
    real gain[MAX_ENTRIES * MAX_AXES];
    real jump[4];
    real predicted[MAX_AXES];
    real noise[MAX_AXES];
    real assumed[MAX_AXES];
    real innovation[MAX_AXES];
    real variance[MAX_AXES];
    real shared;
    real deviation[MAX_AXES];
} Workspace;

/* The next multiple of four, so that rows fill vector registers. */
static inline whole filled_up(whole n)
{
    return (n + 3) / 4 * 4;
}

/* States and all constants of what is carried: those of effects that are only watched stand behind. */
static inline whole carried_by(const Settings *settings)
{
    return settings->states + settings->sense_constants + settings->flow_constants;
}

/* Make scratch ready for an observer of n states and active constants. */
static inline void workspace_begin(Workspace *work, const Settings *settings, whole n)
{
    memset(work, 0, sizeof *work);
    work->n = n;
    work->total = carried_by(settings);
    work->flow.columns = filled_up(1 + settings->states + settings->flow_constants);
    work->flow.push.constants = work->flow.columns + settings->sense_constants - settings->states; /* by rows of lanes */
}

#endif
