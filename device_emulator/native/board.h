/* The board's turn over samples: a drive taken, its intervals gone through, SENSE made.

   device_emulator/board.py sees to everything else, and is asked by `ask` for what is no sample. */
#ifndef EMULATOR_BOARD_H
#define EMULATOR_BOARD_H

#include "../../firmware/src/hil_frame.h" /* the wire; the host has code of its own */
#include "device.h"

enum {
    HORIZON = 65536, /* ticks: a drive for one that far ahead is to come, any other has passed */
    MOST_ROWS = (HIL_MAX_PAYLOAD - HIL_SENSE_SIZE) / (2 * HIL_SENSE_COLUMNS),
    MOST_SAID = 32768, /* bytes of a SENSE and a STATUS, in CAN frames too */
};

/* NONE: no tick, no sequence number. PASS: Python is to take what was heard; nothing has changed, or it raised. */
#define NONE INT64_MIN
#define PASS (-1)

/* What Python is asked to do; −1 is its answer where it raised. */
enum {
    ASK_PAGE,    /* hand on a page of rows and draw the noise of the next */
    ASK_PROTECT, /* trip, or see that the fault is gone, for the interval that begins at tick `value` */
    ASK_STARVED, /* SAFE: the watchdog has tripped */
    ASK_SENSE,   /* put SENSE, from tick `value`, where this link wants no byte stream: its bytes */
    ASK_STATUS,  /* put STATUS: its bytes */
};

/* A drive, by the tick of the interval that it acts on first. */
typedef struct {
    int64_t tick, round; /* `round`: it counts while this is the board's */
    int32_t u[2];
    int64_t limited; /* whether it had to be */
} command_t;

typedef struct {
    const device_t *device;
    int64_t (*ask)(int64_t what, int64_t value, uint8_t *to);
    command_t *waiting; /* HORIZON of them */

    /* as scenario and registers say */
    int64_t stream; /* the link carries bytes */
    int64_t width, latency, protects;
    int64_t lockstep, gain_mode, block, watchdog, status_every, limit;

    /* where it stands: counters of STATUS, next tick that needs a drive, tick at which the watchdog was last fed */
    int64_t state, late, held, saturated, trips, due, fed;

    /* the conversation: numbers expected and next; the newest tick heard; frames that look repeated; whether a part of
       a frame waits */
    int64_t expected, seq, heard, run, pending;

    /* the command that is held; those of an earlier round are forgotten */
    int32_t u[2];
    int64_t limited, round, newest;

    /* rows of the next SENSE */
    int64_t count, flags, matrix;
    int32_t codes[MOST_ROWS][HIL_SENSE_COLUMNS];
} board_t;

static bool streams(const board_t *board)
{
    return board->state == HIL_STATE_RUNNING || board->state == HIL_STATE_ARMED;
}

/* Bring codes within the limit; whether that changed them. */
static bool bounded(int32_t u[2], int64_t limit)
{
    bool changed = false;
    for (int axis = 0; axis < 2; axis++)
        if (u[axis] > limit || u[axis] < -limit) {
            u[axis] = (int32_t)(u[axis] > limit ? limit : -limit);
            changed = true;
        }
    return changed;
}

static command_t *slot(const board_t *board, int64_t tick)
{
    return &board->waiting[tick & (HORIZON - 1)];
}

/* Forget every command: zero force. */
static void forget(board_t *board)
{
    board->round++;
    board->u[0] = board->u[1] = 0;
    board->limited = 0;
    board->newest = NONE;
}

/* Bring the command that is held, and those that wait, within the limit. */
static void limit_drives(board_t *board)
{
    board->limited |= bounded(board->u, board->limit);
    for (int64_t tick = board->device->state->tick; tick <= board->newest; tick++) {
        command_t *command = slot(board, tick);
        if (command->tick == tick && command->round == board->round)
            command->limited |= bounded(command->u, board->limit);
    }
}

/* Queue a drive within its limits; its effective tick, NONE if that has passed. */
static int64_t queue(board_t *board, int32_t ux, int32_t uy, uint32_t effective_tick)
{
    int64_t now = board->device->state->tick, first_open = now + (board->latency > 0);
    uint32_t ahead = effective_tick - (uint32_t)first_open;
    if (ahead >= HORIZON) {
        board->late++;
        return NONE;
    }
    command_t command = {.tick = first_open + ahead, .round = board->round, .u = {ux, uy}};
    command.limited = bounded(command.u, board->limit);
    board->saturated += command.limited;
    *slot(board, command.tick) = command;
    if (command.tick > board->newest)
        board->newest = command.tick;
    board->fed = now;
    return command.tick;
}

/* Begin the interval that starts at `tick`: whether a command came into force. */
static bool take(board_t *board, int64_t tick)
{
    command_t *command = slot(board, tick);
    if (command->tick != tick || command->round != board->round)
        return false;
    command->round = 0;
    memcpy(board->u, command->u, sizeof board->u);
    board->limited = command->limited;
    return true;
}

/* Settle which drive is held over the interval that starts at `tick`; false where Python raised. */
static bool begin(board_t *board, int64_t tick)
{
    if (board->protects && streams(board) && board->ask(ASK_PROTECT, tick, NULL) < 0)
        return false;
    bool came = take(board, tick);
    if (board->state != HIL_STATE_RUNNING)
        return true;
    if (tick - board->fed >= board->watchdog) {
        board->trips++;
        return board->ask(ASK_STARVED, tick, NULL) >= 0;
    }
    if (tick != board->due)
        return true;
    board->due += board->block;
    if (!came) {
        board->held++;
        board->flags |= HIL_SENSE_FLAGS_HELD;
    }
    return true;
}

/* The next row, under the drive codes that stand in it. */
static bool go_through(board_t *board, int32_t codes[HIL_SENSE_COLUMNS])
{
    const device_t *device = board->device;
    int64_t tick = device->state->tick + 1, place = tick % PAGE;
    if (place == 0 && device->state->page != tick && board->ask(ASK_PAGE, tick, NULL) < 0)
        return false;
    memcpy(device->drive_codes[place], codes + 2, sizeof *device->drive_codes);
    if (advance(device, place, 1))
        board->flags |= HIL_SENSE_FLAGS_CLIPPED;
    memcpy(codes, device->sense_codes[place], sizeof *device->sense_codes);
    return true;
}

typedef struct {
    uint8_t *at;
    size_t size;
} written_t;

static void put(void *context, const uint8_t *data, size_t size)
{
    written_t *written = context;
    memcpy(written->at + written->size, data, size);
    written->size += size;
}

/* SENSE of the rows at hand, as a frame; how many bytes that makes. */
static int64_t frame(board_t *board, int64_t first, uint8_t *to)
{
    uint8_t payload[HIL_MAX_PAYLOAD];
    hil_sense head = {.n = (uint16_t)board->count,
                      .width = (uint8_t)board->width,
                      .flags = (uint8_t)board->flags,
                      .matrix_id = (uint8_t)board->matrix};
    size_t size = hil_pack_sense(&head, payload);
    for (int64_t row = 0; row < board->count; row++)
        for (unsigned column = 0; column < HIL_SENSE_COLUMNS; column++)
            for (int64_t byte = 0; byte < board->width; byte++)
                payload[size++] = (uint8_t)((uint32_t)board->codes[row][column] >> (8 * byte));
    hil_frame sense = {.type = HIL_TYPE_SENSE,
                       .sequenced = true,
                       .seq = (uint16_t)board->seq,
                       .tick = (uint32_t)first,
                       .payload = payload,
                       .size = size};
    written_t written = {to, 0u};
    hil_frame_write(&sense, put, &written);
    board->seq = (board->seq + 1) & 0xFFFF;
    return (int64_t)written.size;
}

static int64_t stretches(int64_t tick, int64_t every) /* that are over by it */
{
    return (tick - modulo(tick, every)) / every;
}

/* SENSE of the rows at hand, the last of them just sampled, and STATUS where one is due; how many bytes, or PASS. */
static int64_t tell(board_t *board, uint8_t *to)
{
    int64_t last = board->device->state->tick, first = last - board->count + 1, every = board->status_every;
    int64_t size = board->stream ? frame(board, first, to) : board->ask(ASK_SENSE, first, to);
    board->count = board->flags = 0;
    if (size < 0)
        return PASS;
    if (!streams(board) || (every > 0 && stretches(last, every) > stretches(first - 1, every))) {
        int64_t more = board->ask(ASK_STATUS, last, to + size);
        if (more < 0)
            return PASS;
        size += more;
    }
    return size;
}

/* Force mode: go on by a block; SENSE, and STATUS where one is due. */
static int64_t go_on(board_t *board, uint8_t *to)
{
    int64_t before = board->device->state->tick;
    board->count = board->block;
    board->flags = board->matrix = 0;
    for (int64_t row = 0; row < board->count; row++) {
        if (!begin(board, before + row))
            return PASS;
        memcpy(board->codes[row] + 2, board->u, sizeof board->u);
        if (board->limited)
            board->flags |= HIL_SENSE_FLAGS_SATURATED;
    }
    for (int64_t row = 0; row < board->count; row++)
        if (!go_through(board, board->codes[row]))
            return PASS;
    return tell(board, to);
}

/* The only message in `data`, if that is one whole frame, undamaged, next in sequence, with a drive. */
static bool is_drive(const board_t *board, const uint8_t *data, int64_t size, uint32_t *tick, hil_drive_force *drive)
{
    uint8_t body[HIL_MIN_BODY + HIL_MAX_HOST_PAYLOAD];
    hil_reader reader;
    hil_frame heard;
    if (size < 1 || size > (int64_t)sizeof body + 3 || data[0] != 0u)
        return false;
    hil_reader_init(&reader, body, sizeof body);
    for (int64_t k = 0; k < size - 1; k++)
        if (hil_reader_take(&reader, data[k], &heard) || (k > 0 && data[k] == 0u))
            return false;
    if (!hil_reader_take(&reader, data[size - 1], &heard) || heard.type != HIL_TYPE_DRIVE_FORCE ||
        heard.seq != board->expected)
        return false;
    *tick = heard.tick;
    return hil_unpack_drive_force(drive, heard.payload, heard.size);
}

/* The 64-bit tick closest to `near` with these low bits. */
static int64_t unwrapped(uint32_t low, int64_t near)
{
    int64_t tick = near + (int32_t)(low - (uint32_t)near);
    return tick >= 0 ? tick : (int64_t)low;
}

/* Answer a drive of a board that runs in force mode: in lockstep with the next SENSE. Anything else is for Python. */
static int64_t answer(board_t *board, const uint8_t *data, int64_t size, uint8_t *to)
{
    uint32_t tick;
    hil_drive_force drive;
    if (board->state != HIL_STATE_RUNNING || board->gain_mode || board->pending || !board->stream ||
        !is_drive(board, data, size, &tick, &drive))
        return PASS;
    board->expected = (board->expected + 1) & 0xFFFF;
    board->run = 0;
    board->heard = unwrapped(tick, board->heard);
    queue(board, drive.ux, drive.uy, drive.effective_tick);
    return board->lockstep ? go_on(board, to) : 0;
}

#endif
