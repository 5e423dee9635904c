/* Functions of the core's headers one by one, for tests (core_pieces.py). */
#include "estimator.h"
#include "gain_matrix.h"
#include "scan.h"

#define PIECE __attribute__((visibility("default")))

PIECE whole p_workspace(Workspace *work, const Settings *settings, whole n)
{
    workspace_begin(work, settings, n);
    return (whole)sizeof *work;
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

PIECE whole p_predict_measurement(const Settings *settings, const whole *active, whole count, Memory *memory,
                                  const real *x, const real *z, const real *u, whole terms, real h, Workspace *work)
{
    const Sample sample = {z, u, terms, h};
    const Observer observer = {.count = count, .n = work->n, .settings = settings, .memory = memory,
                               .active = active, .x = (real *)x};
    return predict_measurement(&observer, &sample, work);
}

PIECE void p_gradient(const real *s, real k, real w, real rate, real *out)
{
    pattern_gradient(s, k, w, rate, out);
}
