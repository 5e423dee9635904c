/* Functions of scan.h one by one, for tests (test_scan_pieces.py). */
#include "scan.h"

#define PIECE __attribute__((visibility("default")))

/* Of `count` coefficients behind the other constants; scratch as of a scan. */
static Following followed(whole states, whole constants, whole count, whole rows, real *scratch)
{
    Following follow = {.count = count, .constants = constants, .origin = constants - count, .rate_row = -1};
    follow.watched = count;
    follow.rows = rows;
    follow.by_constants = scratch;
    follow.signature = scratch + 2 * constants;
    follow.product = follow.signature + 2 * count;
    (void)states;
    return follow;
}

PIECE void s_gradient(const real *s, real k, real w, real rate, real *out)
{
    pattern_gradient(s, k, w, rate, out);
}

PIECE void s_responses(const Settings *settings, const real *c, real h, Workspace *work, real *out)
{
    Following follow = {.count = 0};
    responses(settings, c, h, &work->flow, &follow);
    memcpy(out, follow.response, sizeof follow.response);
}

PIECE void s_rows(const real *g, whole states, whole rows, whole count, real *delta, real *scratch)
{
    Following follow = followed(states, count, count, rows, scratch);
    follow.delta = delta;
    multiply_rows(g, states, &follow);
}

PIECE void s_pull(whole row, const real *gain, whole rows, whole count, real *delta, real *scratch)
{
    Following follow = followed(4, count, count, rows, scratch);
    follow.delta = delta;
    pull(row, gain, &follow);
}

PIECE void s_turn(const Settings *settings, const real *s, real w, real rate, real sign, whole rate_row, whole count,
                  real *delta, real *turned)
{
    Following follow = {.count = count, .rate_row = rate_row};
    follow.delta = delta;
    follow.turned = turned;
    add_turn(settings, s, w, rate, sign, &follow);
}

PIECE void s_forced(const Settings *settings, const Memory *memory, const real *before, const real *x, whole total,
                    whole count, const real *u, whole terms, real h, Workspace *work, real *scratch, real *delta)
{
    Following follow = followed(settings->states, total - settings->states, count, 13, scratch);
    Sample sample = {u, u, terms, h};
    follow.delta = delta;
    responses(settings, x + settings->states, h, &work->flow, &follow);
    signal_values(settings, memory, memory->time, work->flow.push.signals);
    add_forced(settings, memory, before, x + settings->states, &sample, &follow, work);
}

PIECE void s_sensed(const Settings *settings, const Memory *memory, const real *x, whole total, whole count,
                    const real *u, whole terms, Workspace *work, real *scratch, real *signature)
{
    Following follow = followed(settings->states, total - settings->states, count, 13, scratch);
    follow.signature = signature;
    signal_values(settings, memory, memory->time, work->flow.push.signals);
    watch_sensed(settings, x, u, terms, &follow, work);
}

PIECE void s_recall(const Settings *settings, Memory *memory, const whole *active, whole active_count,
                    const real *prior, const real *spread, const real *initial, real *x, real *p, whole count,
                    real *scratch, real *delta)
{
    whole n = settings->states + active_count;
    Following follow = followed(settings->states, count, count, n, scratch);
    real wide[MAX_ENTRIES * MAX_WIDTH];
    widen(p, n, wide, filled_up(n));
    Estimate estimate = {n, filled_up(n), n, x, wide, wide, memory};
    Constants constants = {prior, prior, spread, initial};
    Arrays observer = {.count = active_count, .n = n, .active = active};
    real rows[4 * 16];
    follow.delta = delta;
    recall(settings, &observer, &constants, &estimate, rows, &follow);
    narrow(wide, filled_up(n), p, n);
}
