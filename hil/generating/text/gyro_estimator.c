/* @TITLE@
 *
 * Written by `hil generate` of gyrohil @PRODUCT@ from @BENCH@; not to be edited. Compile it with contraction off
 * (-ffp-contract=off): then one instruction set gives one result.
 */
#include "gyro_estimator.h"

#include <float.h>
#include <math.h>
#include <string.h>

typedef gyro_real real;
typedef gyro_whole whole;
@TYPEDEFS@
/* ------------------------------------------------------------------ the core: model, observer, controller, angle */

@CORE@

/* ---------------------------------------------------------------------------------- what the bench file declares */

#define ESTIMATED @N@ /* states and constants that are estimated */
#define TOTAL @TOTAL@

@DATA@

/* -------------------------------------------------------------------------------------------------- the interface */

unsigned gyro_estimator_version(void)
{
    return GYRO_ESTIMATOR_VERSION;
}

size_t gyro_estimator_size(void)
{
    return sizeof(gyro_estimator);
}

void gyro_estimator_init(gyro_estimator *estimator)
{
    memset(estimator, 0, sizeof *estimator);
    memcpy(estimator->x, initial_state, sizeof initial_state);
    for (whole i = 0; i < ESTIMATED; i++) {
        estimator->p[i * filled_up(ESTIMATED) + i] = initial_variance[i];
@INIT_SECOND@    }
    estimator->memory.nis = R(1.0);
    estimator->memory.dither = UINT64_C(@DITHER@);
    workspace_begin(&estimator->work, &settings, ESTIMATED);
}

/* z and u are scaled. A drive that is not finite is missing: it becomes the one that was asked for. */
static void observe(gyro_estimator *estimator, const real z[2], real u[2])
{
    for (int i = 0; i < 2; i++)
        if (!isfinite(u[i]))
            u[i] = estimator->memory.queue[0][i];
    const Observer observer = {
        .count = ESTIMATED - 4, .n = ESTIMATED, .width = filled_up(ESTIMATED), .total = TOTAL, .angles = @ANGLES@,
        .phases = @PHASES@, .settings = &settings, .memory = &estimator->memory, .active = active,
        .intensity = intensity, .prior = prior, .spread = spread, .initial = (real *)initial_constants, .table = gains,
        .x = estimator->x, .p = estimator->p, .c = @C@, /* nothing writes to the initial values without electrodes */
    };
    const Sample sample = {z, u, 1, settings.h};
    advance_queue(&settings, &estimator->memory, u);
    advance_filter(&observer, &sample, &estimator->work, &estimator->row);
}

static void drive(gyro_estimator *estimator, int drive_on, double codes[2])
{
    real *commanded = estimator->memory.queue[settings.latency];
    if (drive_on) {
        command(&settings, &estimator->memory, estimator->x, &estimator->work, codes);
        return;
    }
    for (int i = 0; i < 2; i++)
        codes[i] = 0.0;
    for (int i = 0; i < 3; i++)
        commanded[i] = R(0.0);
}

void observer_step(gyro_estimator *estimator, const gyro_real sense_V[2], const gyro_real applied_mps2[2])
{
    real z[2], u[2];
    for (int i = 0; i < 2; i++) {
        z[i] = sense_V[i] / unit_V[i];
        u[i] = applied_mps2[i] / unit_mps2;
    }
    observe(estimator, z, u);
}

void controller_step(gyro_estimator *estimator, int drive_on, gyro_real drive_mps2[2])
{
    double codes[2];
    drive(estimator, drive_on, codes);
    for (int i = 0; i < 2; i++)
        drive_mps2[i] = (real)(codes[i] * GYRO_DRIVE_SCALE_MPS2);
}

void estimator_step(gyro_estimator *estimator, const gyro_real sense_V[2], const gyro_real applied_mps2[2],
                    int drive_on, gyro_real drive_mps2[2], double *angle_rad)
{
    observer_step(estimator, sense_V, applied_mps2);
    controller_step(estimator, drive_on, drive_mps2);
    *angle_rad = estimator->row.angle;
}

void estimator_step_codes(gyro_estimator *estimator, const int32_t sense[2], const int32_t applied[2], int drive_on,
                          int32_t drive_codes[2])
{
    real z[2], u[2];
    double codes[2];
    for (int i = 0; i < 2; i++) {
        z[i] = sense[i] == GYRO_MISSING ? (real)NAN : (real)sense[i] * settings.sense_scale[i];
        u[i] = applied[i] == GYRO_MISSING ? (real)NAN : (real)applied[i] * settings.quantum;
    }
    observe(estimator, z, u);
    drive(estimator, drive_on, codes);
    for (int i = 0; i < 2; i++)
        drive_codes[i] = (int32_t)codes[i];
}

/* The root of a variance; NaN of one that is none. */
static real root(real variance)
{
    return variance >= R(0.0) ? SQRT(variance) : (real)NAN;
}

void gyro_estimator_read(const gyro_estimator *estimator, gyro_estimate *estimate)
{
    const Output *row = &estimator->row;
    for (whole i = 0; i < TOTAL; i++) {
        estimate->state[i] = estimator->x[i] * unit[i];
        estimate->deviation[i] = R(-1.0);
    }
    for (whole i = 0; i < ESTIMATED; i++) {
        whole entry = entry_of(&settings, active, i);
        estimate->deviation[entry] = root(estimator->@ACTUAL@[i * filled_up(ESTIMATED) + i]) * FABS(unit[entry]);
    }
    for (int i = 0; i < 2; i++) {
        estimate->innovation_V[i] = row->nu[i] * unit_V[i];
        estimate->innovation_deviation_V[i] = root(row->s[i]) * FABS(unit_V[i]);
    }
    estimate->angle_rad = row->angle;
    estimate->angle_deviation_rad = root(row->angle_variance);
    estimate->energy_ratio = row->energy_ratio;
    estimate->quadrature_ratio = row->quadrature_ratio;
    estimate->valid = isfinite(row->angle) && FABS(row->energy_ratio - R(1.0)) <= R(@ENERGY@) &&
                      FABS(row->quadrature_ratio) <= R(@QUADRATURE@);
}
