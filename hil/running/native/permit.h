/* Board mode's answer: the board's own estimator may drive, or not. */

#ifndef TURN_PERMIT_H
#define TURN_PERMIT_H

#include "answer.h"

/* Whether rows show a drive that no board may show which keeps to what it was told. */
static bool drives_unbidden(permit_t *permit, const row_t *rows, int64_t count)
{
    int64_t most = 0;
    for (int64_t k = 0; k < count; k++)
        for (int column = 2; column < 4; column++)
            if (llabs(rows[k].codes[column]) > most)
                most = llabs(rows[k].codes[column]);
    permit->odd = most > permit->limit ? PERMIT_BEYOND : most > 0 && !permit->permitted ? PERMIT_DRIVES : PERMIT_FINE;
    permit->odd_tick = rows[0].tick;
    permit->odd_drive = most;
    return permit->odd != PERMIT_FINE;
}

/* Permit the board to go on, and to drive once the loop may be closed. */
static int answer_permit(turn_t *turn)
{
    uint8_t drive = (uint8_t)turn->blocks->closed;
    int why = send_answer(turn, HIL_TYPE_DRIVE_BOARD, &drive, HIL_DRIVE_BOARD_SIZE);
    if (why == TURN_DONE)
        turn->permit->permitted = drive;
    return why;
}

#endif
