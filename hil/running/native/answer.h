/* What all modes have in common: a sample judged, an answer on its way, samples waited for. */

#ifndef TURN_ANSWER_H
#define TURN_ANSWER_H

#include "link.h"
#include "track.h"

#define RESIDUAL_SAMPLES 200.0 /* over which the residual is averaged: hil.running.loop.skeleton has it too */

/* Judge the newest sample: stop the run when the residual, the innovation's mean square in units of the noise, leaves
   its bounds. */
static void judge(turn_t *turn, int64_t since)
{
    double x = turn->newest[0] / turn->noise[0], y = turn->newest[1] / turn->noise[1];
    turn->residual += (0.5 * (x * x + y * y) - turn->residual) * (1.0 / RESIDUAL_SAMPLES);
    /* Which neither NaN nor infinity is, however wide the limit. */
    bool inside = turn->residual <= turn->residual_limit && turn->residual < INFINITY;
    if (since >= turn->guarded && !inside) {
        turn->residual_safe++;
        turn->stop = 1;
    }
}

static void note_silence(turn_t *turn)
{
    int64_t silent_ns = turn->sent_ns - turn->answered_ns;
    if (silent_ns > turn->suspicious_ns && silent_ns > turn->silence_ns)
        turn->silence_ns = silent_ns;
    turn->answered_ns = turn->sent_ns;
}

/* Send what lets the board go on. */
static int send_answer(turn_t *turn, uint8_t type, const uint8_t *payload, size_t size)
{
    int done = send_message(turn, type, payload, size);
    if (done != CAME)
        return done == CLOSED ? TURN_CLOSED : TURN_FAILED;
    turn->drives++;
    note_silence(turn);
    return TURN_DONE;
}

/* Keep rows for those who look at each; whether there are as many as they asked for. */
static bool look_at(turn_t *turn, const row_t *rows, int64_t count)
{
    if (turn->look_after == INT64_MAX)
        return false;
    memcpy(turn->seen + turn->seen_count, rows, (size_t)count * sizeof *rows);
    turn->seen_count += count;
    return turn->seen_count >= turn->look_after;
}

/* Wait for rows and messages. */
static int hear(turn_t *turn)
{
    int64_t listened_ns = now_ns(), end_ns = listened_ns + turn->slice_ns, left_ns = turn->slice_ns;
    turn->batch.row_count = turn->row_at = 0;
    for (;;) {
        switch (receive(turn, left_ns)) {
        case WOKEN:
            return TURN_WOKEN;
        case CLOSED:
            return TURN_CLOSED;
        case RAISED:
            return TURN_FAILED;
        }
        if (turn->batch.said_size > 0)
            turn->news = 1;
        if (turn->batch.row_count > 0) {
            turn->turns++;
            turn->behind += turn->received_ns - listened_ns < turn->at_once_ns;
            return TURN_DONE;
        }
        left_ns = end_ns - now_ns(); /* a part of a frame is neither a sample nor silence */
        if (turn->news || turn->link.kind >= LINK_BYTES || left_ns <= 0) {
            turn->news = 0;
            return TURN_QUIET;
        }
    }
}

/* Whether nothing more is to be read for now. */
static bool is_done(const turn_t *turn)
{
    return turn->stop || (turn->first != NONE && turn->next - turn->first >= turn->goal);
}

#endif
