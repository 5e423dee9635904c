/* Functions of the core's headers one by one, for tests (core_pieces.py). */
#include "estimator.h"
#include "gain_matrix.h"
#include "stationary.h"

#include <stddef.h>

#define PIECE __attribute__((visibility("default")))

PIECE void p_places(int64_t *places)
{
    const size_t all[] = {sizeof(Workspace),
                          offsetof(Workspace, flow.push),
                          offsetof(Workspace, jacobian),
                          offsetof(Workspace, full),
                          offsetof(Workspace, gain),
                          offsetof(Workspace, predicted),
                          offsetof(Workspace, noise),
                          offsetof(Workspace, innovation),
                          offsetof(Workspace, variance)};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        places[i] = (int64_t)all[i];
}

PIECE void p_workspace(Workspace *work, const Settings *settings, whole n, whole total)
{
    workspace_begin(work, settings, n, total);
}

PIECE void p_pattern(const real *s, real k, real w, real rate, real *out)
{
    Pattern found = pattern(s, k, w, rate);
    out[0] = found.twice;
    out[1] = found.energy;
    out[2] = found.momentum;
}

PIECE real p_unwrap(real twice, real before)
{
    return unwrap_half_turns(twice, before);
}

PIECE void p_note_forced(const Settings *settings, Memory *memory, const real *x, real h)
{
    note_forced_rotation(settings, memory, x, h);
}

PIECE void p_read_angle(const Settings *settings, Memory *memory, const real *x, real h, Output *row)
{
    read_angle(settings, memory, x, h, row);
}

PIECE void p_note_gradient(const Settings *settings, Memory *memory, const real *s)
{
    note_gradient(settings, memory, s);
}

PIECE whole p_refer(const Settings *settings, Memory *memory)
{
    return refer_angle(settings, memory);
}

/* A covariance with rows as the core has them, and scratch of that width. */
typedef struct {
    whole n;
    whole width;
    real p[MAX_ENTRIES * MAX_WIDTH];
    real scratch[8 * MAX_WIDTH];
} Wide;

static Wide wide_of(const real *p, whole n)
{
    Wide wide = {.n = n, .width = filled_up(n)};
    widen(p, n, wide.p, wide.width);
    return wide;
}

static void put_back(const Wide *wide, real *p)
{
    narrow(wide->p, wide->width, p, wide->n);
}

PIECE void p_correct_angle(Memory *memory, const real *c, whole n, const real *jacobian, const real *noise,
                           whole channels, const real *gain)
{
    Wide wide = wide_of(c, n);
    project(wide.p, n, wide.width, jacobian, channels, wide.scratch);
    correct_angle(memory, wide.scratch, n, wide.width, jacobian, noise, channels, gain);
}

PIECE void p_recall_angle(Memory *memory, const real *c, whole n, whole row, const real *gain, real noise)
{
    recall_angle(memory, c, n, n, row, gain, noise);
}

PIECE real p_dither(Memory *memory, real amplitude)
{
    return dither_force(memory, amplitude);
}

PIECE real p_virtual_rate(const Settings *settings, real time)
{
    return virtual_rate(settings, time);
}

PIECE real p_acting(const Settings *settings, const Memory *memory)
{
    return acting(settings, memory);
}

PIECE void p_holds(const Settings *settings, const Memory *memory, const real *s, real rate, real w, real fastest,
                   real *out)
{
    holds(settings, memory, s, rate, w, fastest, out, out + 1);
}

PIECE void p_control_law(const Settings *settings, const Memory *memory, const real *s, const real *c, real *out)
{
    control_law(settings, memory, s, c, out);
}

PIECE void p_undo(const Settings *settings, const real *c, const real *s, Push *push, real *force)
{
    undo_effects(settings, c, s, push, force);
}

PIECE void p_command(const Settings *settings, Memory *memory, const real *x, Workspace *work, double *out)
{
    command(settings, memory, x, work, out);
}

PIECE void p_advance_queue(const Settings *settings, Memory *memory, const real *u)
{
    advance_queue(settings, memory, u);
}

PIECE void p_orbit(real t, real rotation, real *s)
{
    orbit(t, rotation, s);
}

PIECE void p_holding(const real *c, const real *s, real rotation, real *u)
{
    holding_force(c, s, rotation, u);
}

PIECE void p_propagate(real *p, whole n, whole width, const real *g, whole states, real *scratch, real factor)
{
    if (width == filled_up(width)) {
        propagate(p, n, width, g, states, scratch, factor);
        return;
    }
    Wide wide = wide_of(p, n);
    propagate(wide.p, n, wide.width, g, states, wide.scratch, factor);
    put_back(&wide, p);
}

PIECE void p_process_noise(real *p, whole width, const Settings *settings, real h, const real *s, const whole *active,
                           whole count, const real *intensity, real *jumped)
{
    add_process_noise(p, width, settings, h, s, active, count, intensity, jumped);
}

PIECE real p_kalman_gain(const real *p, whole n, const real *jacobian, const real *noise, whole channels,
                         const real *nu, real *gain)
{
    Wide wide = wide_of(p, n);
    project(wide.p, n, wide.width, jacobian, channels, wide.scratch);
    return kalman_gain(wide.scratch, n, wide.width, jacobian, noise, channels, nu, gain);
}

PIECE void p_joseph(real *p, whole n, const real *jacobian, const real *noise, whole channels, const real *gain)
{
    Wide wide = wide_of(p, n);
    project(wide.p, n, wide.width, jacobian, channels, wide.scratch);
    joseph(wide.p, n, wide.width, wide.scratch, jacobian, noise, channels, gain, wide.scratch + 2 * wide.width);
    put_back(&wide, p);
}

PIECE void p_rank_one(real *p, whole n, whole row, const real *gain, real noise)
{
    Wide wide = wide_of(p, n);
    real padded[MAX_WIDTH] = {R(0.0)};
    memcpy(padded, gain, (size_t)n * sizeof *gain);
    rank_one(wide.p, n, wide.width, row, padded, noise, wide.scratch);
    put_back(&wide, p);
}

PIECE real p_measure_two(real *p, whole n, whole width, Memory *memory, Workspace *work)
{
    return measure_two(p, n, width, memory, work);
}

PIECE real p_fading(const Settings *settings, const Memory *memory)
{
    return fading_factor(settings, memory);
}

PIECE void p_recall_initial(const Settings *settings, const whole *active, whole index, real initial, real noise,
                            whole n, real *x, real *p, real *c, Memory *memory)
{
    Wide wide = wide_of(p, n), actual = wide_of(c, n);
    Estimate estimate = {n, wide.width, n, x, wide.p, actual.p, memory};
    recall_initial(settings, active, index, initial, noise, &estimate, wide.scratch);
    put_back(&wide, p);
    if (settings->two_covariances == 1)
        put_back(&actual, c);
}

PIECE void p_remember_prior(const Settings *settings, const whole *active, whole count, const real *prior,
                            const real *spread, const real *initial, whole n, real *x, real *p, real *c,
                            Memory *memory)
{
    Constants constants = {NULL, prior, spread, initial};
    Wide wide = wide_of(p, n), actual = wide_of(c, n);
    Estimate estimate = {n, wide.width, n, x, wide.p, actual.p, memory};
    remember_prior(settings, active, count, &constants, &estimate, wide.scratch);
    put_back(&wide, p);
    if (settings->two_covariances == 1)
        put_back(&actual, c);
}

PIECE void p_add_correction(const Settings *settings, const whole *active, whole n, const real *gain, const real *nu,
                            real *x)
{
    Estimate estimate = {n, n, n, x, NULL, NULL, NULL};
    add_correction(settings, active, n, gain, nu, &estimate);
}

PIECE void p_tabulated(const real *gains, whole angles, whole phases, whole n, const real *s, real *gain)
{
    Table table = {angles, phases, 2, gains};
    tabulated_gain(&table, n, s, gain);
}

PIECE whole p_riccati(const Settings *settings, const Memory *memory)
{
    return runs_riccati(settings, memory);
}

PIECE void p_shift_drives(real (*past)[MAX_AXES][MAX_DEGREE], const real *u, whole terms)
{
    shift_drives(past, u, 2, terms);
}

PIECE void p_remember_drive(const Settings *settings, Memory *memory, const real *u)
{
    remember_drive(settings, memory, u, 1);
}

PIECE void p_correct(const Settings *settings, const whole *active, whole count, const real *intensity,
                     const real *prior, const real *spread, const real *initial, const real *gains, whole angles,
                     whole phases, whole n, real *x, real *p, real *c, Memory *memory, const real *z, const real *u,
                     real h, Workspace *work)
{
    Constants constants = {intensity, prior, spread, initial};
    Table table = {angles, phases, settings->axes, gains};
    Wide wide = wide_of(p, n), actual = wide_of(c, n);
    Estimate estimate = {n, wide.width, n, x, wide.p, actual.p, memory};
    Sample sample = {z, u, 1, h};
    correct(settings, active, count, &constants, &table, &estimate, &sample, work);
    put_back(&wide, p);
    if (settings->two_covariances == 1)
        put_back(&actual, c);
}

PIECE whole p_predict_measurement(const Settings *settings, const whole *active, whole count, Memory *memory,
                                  const real *x, const real *z, const real *u, whole terms, real h, Workspace *work)
{
    Sample sample = {z, u, terms, h};
    return predict_measurement(settings, active, count, memory, x, &sample, work);
}
