/* What Python calls of the emulator: the device by rows, and the board's turn over samples. */

#include "board.h"
#include "feedback.h"

#define EXPORT __attribute__((visibility("default")))

/* Produce n rows of the page from row `first` on; 1 when the converter clipped. */
EXPORT int device_advance(const device_t *device, int64_t first, int64_t n)
{
    return advance(device, first, n);
}

/* `device_advance` with each row's drive codes from the loop that is closed on the board. */
EXPORT int device_advance_closed(const device_t *device, int64_t first, int64_t n, feedback_t *loop)
{
    bool clipped = false;
    for (int64_t row = first; row < first + n; row++) {
        due(loop, device->state->tick + 1, device->drive_codes[row]);
        clipped |= advance(device, row, 1);
        feed_back(loop, device->state->tick, device->sense_codes[row]);
    }
    return clipped;
}

/* values: Ω, Ω̇ and ∫Ω dt from 0, at a time within `piece`. */
EXPORT void device_rate_at(const piece_t *piece, double t_s, double values[3])
{
    turn_t turn = rate_at(piece, t_s);
    values[0] = turn.rate_rad_s;
    values[1] = turn.slope_rad_s2;
    values[2] = angle_at(piece, t_s);
}

/* Answer the host's bytes where they are a drive: bytes put into `to`, which has room for MOST_SAID; PASS: Python is to
   take them. It has the shape that hil/wire/inproc.py asks for. */
EXPORT int64_t board_answer(board_t *board, const uint8_t *data, int64_t size, uint8_t *to)
{
    return answer(board, data, size, to);
}

/* Force mode: go on by a block; as `tell`. */
EXPORT int64_t board_go_on(board_t *board, uint8_t *to)
{
    return go_on(board, to);
}

/* SENSE of the rows at hand, and STATUS where one is due. */
EXPORT int64_t board_tell(board_t *board, uint8_t *to)
{
    return tell(board, to);
}

/* Queue a drive; its effective tick, NONE if that has passed. */
EXPORT int64_t board_queue(board_t *board, int32_t ux, int32_t uy, uint32_t effective_tick)
{
    return queue(board, ux, uy, effective_tick);
}

EXPORT void board_forget(board_t *board)
{
    forget(board);
}

EXPORT void board_limit(board_t *board)
{
    limit_drives(board);
}

/* Names of the effects in the order of their numbers, as this library was compiled. */
EXPORT const char *device_effects(void)
{
    return EFFECT_NAMES;
}

/* Bytes of constants, state, effect, piece, feedback, device, command and board, as this file has them. */
EXPORT void device_sizes(int64_t sizes[8])
{
    sizes[0] = sizeof(constants_t);
    sizes[1] = sizeof(state_t);
    sizes[2] = sizeof(effect_t);
    sizes[3] = sizeof(piece_t);
    sizes[4] = sizeof(feedback_t);
    sizes[5] = sizeof(device_t);
    sizes[6] = sizeof(command_t);
    sizes[7] = sizeof(board_t);
}
