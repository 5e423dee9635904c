#include "hil_board.h"

#include <string.h>

/* A sequence number up to this far behind the expected one is a repetition; further behind, a jump ahead. */
#define REPEAT_WINDOW 256u

/* So many frames in a row, each following the one before, move the count back to where they are: the number ahead of
 * them was a stray one. */
#define REPEAT_RUN 4u

/* An effective tick up to this far ahead is to come; any other, in 32 bits, has passed. */
#define HORIZON 0x10000u

typedef struct reply {
    uint8_t type; /* 0: nothing to say */
    uint8_t payload[HIL_MAX_ANSWER];
    size_t size;
} reply;

static void lock(hil_board *b, bool locked) {
    if (b->config.lock != NULL)
        b->config.lock(b->config.context, locked);
}

static uint32_t tick_now(const hil_board *b) {
    return b->tick < 0 ? 0u : (uint32_t)b->tick;
}

/* What the state table says to an event: nothing has happened yet. */
static const hil_transition *at(const hil_board *b, unsigned event) {
    return &hil_transitions[b->situation][event];
}

uint8_t hil_board_state(const hil_board *board) {
    return hil_situation_state[board->situation];
}

static bool running(const hil_board *b) {
    return b->situation == HIL_SITUATION_RUNNING;
}

bool hil_board_streaming(const hil_board *board) {
    return board->situation == HIL_SITUATION_ARMED || running(board);
}

bool hil_board_lockstep(const hil_board *board) {
    return board->lockstep;
}

/* Whether the drive is computed here, not sent by the host. */
static bool self_driven(const hil_board *b) {
    return b->gain_mode || b->board_mode;
}

bool hil_board_may_go_on(const hil_board *board) {
    return board->lockstep && board->granted > 0u;
}

/* ------------------------------------------------------------------------------------------------- start */

/* Unasked STATUS comes at multiples of its period, ESTIMATE one tick before: one division here instead of one at every
 * tick. */
static void count_down(hil_board *b) {
    if (b->status_every > 0u)
        b->status_left = b->status_every - (uint32_t)((uint64_t)(b->tick + 1) % b->status_every) + 1u;
    if (b->status_left > b->status_every)
        b->status_left -= b->status_every;
    if (b->estimate_every > 0u)
        b->estimate_left = b->estimate_every - (uint32_t)((uint64_t)(b->tick + 1) % b->estimate_every);
}

static void registers_changed(hil_board *b) {
    b->lockstep = hil_registers_whole(&b->registers, HIL_REGISTER_CLOCK_MODE) == HIL_CLOCK_MODE_LOCKSTEP;
    b->gain_mode = hil_registers_whole(&b->registers, HIL_REGISTER_LOOP_MODE) == HIL_LOOP_MODE_GAIN;
    b->board_mode = hil_registers_whole(&b->registers, HIL_REGISTER_LOOP_MODE) == HIL_LOOP_MODE_BOARD;
    b->block_rows = hil_registers_whole(&b->registers, HIL_REGISTER_BLOCK);
    b->watchdog = hil_registers_whole(&b->registers, HIL_REGISTER_WATCHDOG_TICKS);
    b->drive_limit = hil_registers_whole(&b->registers, HIL_REGISTER_DRIVE_LIMIT);
    if (b->drive_limit > (uint32_t)b->drive_max)
        b->drive_limit = (uint32_t)b->drive_max;
    hil_gain_obey(&b->gain, &b->registers, b->drive_limit);
    b->status_every = hil_registers_whole(&b->registers, HIL_REGISTER_STATUS_EVERY);
    b->estimate_every = hil_registers_whole(&b->registers, HIL_REGISTER_ESTIMATE_EVERY);
    count_down(b);
}

/* Every trim output at 0. */
static void zero_trims(hil_board *b) {
    for (unsigned k = 0; k < b->config.trim_count; k++) {
        b->registers.value[HIL_REGISTER_TRIM_0 + k] = 0.0;
        b->config.put_trim(b->config.context, k, 0);
    }
}

static bool are_trims(const hil_config *config) {
    if (config->trim_count > HIL_TRIMS || (config->trim_count > 0u && config->put_trim == NULL))
        return false;
    for (unsigned k = 0; k < config->trim_count; k++) {
        const hil_trim_output *trim = &config->trims[k];
        if (trim->lowest > 0 || trim->highest < 0 || trim->lowest == trim->highest || !(trim->scale_V > 0.0) ||
            !(trim->settling_s >= 0.0) || trim->name_size == 0u || trim->name_size > HIL_TRIM_NAME)
            return false;
    }
    return true;
}

bool hil_board_init(hil_board *board, const hil_config *config) {
    hil_identity *identity = &board->config.identity;
    if (config->link == NULL || config->now_ns == NULL || config->blocks == NULL)
        return false;
    memset(board, 0, sizeof *board);
    board->config = *config;
    identity->protocol = HIL_PROTOCOL;
    identity->spec_hash = HIL_SPEC_HASH;
    identity->capabilities = HIL_CAPABILITIES_FORCE_MODE | HIL_CAPABILITIES_GAIN_MODE;
    if (config->clocks & 1u << HIL_CLOCK_MODE_LOCKSTEP)
        identity->capabilities |= HIL_CAPABILITIES_LOCKSTEP;
    if (config->clocks & 1u << HIL_CLOCK_MODE_PACED)
        identity->capabilities |= HIL_CAPABILITIES_PACED;
    if (config->estimator != NULL)
        identity->capabilities |= HIL_CAPABILITIES_BOARD_MODE;
    if (config->estimator != NULL && config->estimator->read != NULL)
        identity->capabilities |= HIL_CAPABILITIES_ESTIMATE;
    if (!are_trims(config))
        return false;
    if (config->trim_count > 0u)
        identity->capabilities |= HIL_CAPABILITIES_TRIM;

    board->width = identity->sense_bits > 16u || identity->drive_bits > 16u ? 3u : 2u;
    if (identity->sense_bits < 2u || identity->sense_bits > 24u || identity->drive_bits < 2u ||
        identity->drive_bits > 24u)
        return false;
    board->sense_max = (int32_t)((1u << (identity->sense_bits - 1u)) - 1u); /* the lowest code is one further */
    board->drive_max = (int32_t)((1u << (identity->drive_bits - 1u)) - 1u); /* a force can be turned round exactly */
    board->room_rows =
        (uint32_t)((config->blocks_size / 2u - HIL_SENSE_SIZE) / (HIL_SENSE_COLUMNS * (size_t)board->width));
    if (config->blocks_size / 2u < HIL_SENSE_SIZE || board->room_rows == 0u)
        return false;
    if (identity->latency_ticks >= HIL_LATENCY || !(identity->tick_rate_Hz > 0.0))
        return false;
    board->block[0].payload = config->blocks;
    board->block[1].payload = config->blocks + config->blocks_size / 2u;

    hil_registers_init(&board->registers, identity->tick_rate_Hz);
    unsigned clock = HIL_CLOCK_MODE_REAL;
    while (clock > 0u && !(config->clocks & 1u << clock))
        clock--;
    if (!(config->clocks & 1u << clock))
        return false;
    board->registers.value[HIL_REGISTER_CLOCK_MODE] = clock;
    registers_changed(board);
    zero_trims(board);
    board->situation = HIL_SITUATION_BOOT;
    board->tick = -1;
    return true;
}

/* ------------------------------------------------------------------------------------------------ blocks */

static void end_block(hil_board *b) {
    hil_block *block = &b->block[b->filling];
    if (block->rows == 0u)
        return;
    if (b->block[1u - b->filling].full) { /* the link has not taken the one before */
        hil_count(&b->dropped, 1u);
        b->skipped = (uint16_t)(b->skipped + b->config.link->numbers(b->config.link, block->rows, b->width));
        block->rows = 0u;
        return;
    }
    block->full = true;
    b->filling = 1u - b->filling;
    b->block[b->filling].rows = 0u;
}

static void forget_blocks(hil_board *b) {
    for (unsigned k = 0; k < 2u; k++) {
        b->block[k].rows = 0u;
        b->block[k].full = false;
    }
}

static int32_t within(int32_t code, int32_t limit) {
    return code > limit ? limit : code < -limit ? -limit : code;
}

static uint8_t *put_code(uint8_t *at, int32_t code, unsigned width) {
    uint32_t image = (uint32_t)code; /* modulo 2^32: two's complement */
    for (unsigned k = 0; k < width; k++)
        at[k] = (uint8_t)(image >> (8u * k));
    return at + width;
}

static void add_row(hil_board *b, int32_t vx, int32_t vy, uint8_t flags) {
    hil_block *block = &b->block[b->filling];
    uint8_t *at = block->payload + HIL_SENSE_SIZE + (size_t)block->rows * HIL_SENSE_COLUMNS * b->width;
    if (block->rows == 0u) {
        block->tick = b->tick;
        block->flags = 0u;
    }
    at = put_code(at, vx, b->width);
    at = put_code(at, vy, b->width);
    at = put_code(at, b->held.codes.ux, b->width);
    (void)put_code(at, b->held.codes.uy, b->width);
    block->flags |= flags;
    block->matrix_id = hil_gain_matrix_id(&b->gain);
    if (++block->rows >= b->block_rows)
        end_block(b);
}

/* ------------------------------------------------------------------------------------------------ states */

static void forget_drives(hil_board *b) {
    memset(b->waiting, 0, sizeof b->waiting);
    memset(b->computed, 0, sizeof b->computed);
    memset(&b->held, 0, sizeof b->held);
    b->interval_flags = 0u;
    b->driving = false;
}

static void put_now(hil_board *b) {
    if (b->config.put_now != NULL)
        b->config.put_now(b->config.context, b->held.codes);
}

/* An event happens: the state table says what becomes of it. Whatever ends the stream ends the force. */
static const hil_transition *happen(hil_board *b, unsigned event, uint8_t sent) {
    const hil_transition *told = at(b, event);
    bool streamed = hil_board_streaming(b);
    b->situation = told->next;
    if (told->reason != HIL_REASON_KEPT)
        b->reason = told->reason == HIL_REASON_SENT ? sent : told->reason;
    if (streamed && !hil_board_streaming(b)) {
        b->granted = 0u;
        forget_drives(b);
        put_now(b);
        zero_trims(b);
        end_block(b);
    }
    return told;
}

/* An event of the board's own, which STATUS tells. */
static void happen_here(hil_board *b, unsigned event) {
    if (happen(b, event, HIL_SAFE_REASON_NONE)->answer == HIL_TYPE_STATUS)
        b->status_due = true;
}

void hil_board_safe(hil_board *board, uint8_t reason) {
    lock(board, true);
    happen_here(board, reason == HIL_SAFE_REASON_FAULT ? HIL_EVENT_FAULT : HIL_EVENT_LINK_LOST);
    lock(board, false);
}

void hil_board_fault_gone(hil_board *board) {
    lock(board, true);
    happen_here(board, HIL_EVENT_FAULT_GONE);
    lock(board, false);
}

/* Lockstep: the host has answered a block, so the next one may come. */
static void grant(hil_board *b) {
    if (b->lockstep && hil_board_streaming(b))
        b->granted += b->block_rows;
}

/* -------------------------------------------------------------------------------------------------- ticks */

/* The host's drive that is due now; false if there is none. */
static bool take_command(hil_board *b) {
    for (unsigned k = 0; k < HIL_WAITING; k++) {
        hil_command *command = &b->waiting[k];
        if (command->waits && command->tick == b->tick) {
            b->held = *command;
            command->waits = false;
            return true;
        }
    }
    return false;
}

/* Have a drive wait, in place of one for the same tick; false if too many wait already. */
static bool put_command(hil_board *b, int64_t tick, hil_drive codes, bool limited) {
    hil_command *place = NULL;
    for (unsigned k = 0; k < HIL_WAITING; k++) {
        hil_command *command = &b->waiting[k];
        if (!command->waits) {
            if (place == NULL)
                place = command;
        } else if (command->tick == tick) {
            place = command;
            break;
        }
    }
    if (place == NULL)
        return false;
    place->codes = codes;
    place->limited = limited;
    place->waits = true;
    place->tick = tick;
    return true;
}

static void limit_command(hil_command *command, int32_t limit) {
    hil_drive codes = {within(command->codes.ux, limit), within(command->codes.uy, limit)};
    command->limited = command->limited || codes.ux != command->codes.ux || codes.uy != command->codes.uy;
    command->codes = codes;
}

/* Bring every drive that acts or waits within the limit, which may have been lowered. */
static void limit_drives(hil_board *b) {
    int32_t limit = (int32_t)b->drive_limit;
    limit_command(&b->held, limit);
    for (unsigned k = 0; k < HIL_WAITING; k++)
        limit_command(&b->waiting[k], limit);
    for (unsigned k = 0; k < HIL_LATENCY; k++) {
        b->computed[k].ux = within(b->computed[k].ux, limit);
        b->computed[k].uy = within(b->computed[k].uy, limit);
    }
    put_now(b);
}

/* The drive codes that the board's own estimator makes of the codes just sampled; true if they had to be limited. */
static bool step_estimator(hil_board *b, int32_t vx, int32_t vy, int32_t codes[2]) {
    const hil_estimator *estimator = b->config.estimator;
    int32_t limit = (int32_t)b->drive_limit;
    hil_drive drive = estimator->step(estimator->context, b->tick, vx, vy, b->held.codes, b->driving);
    codes[0] = b->driving ? within(drive.ux, limit) : 0;
    codes[1] = b->driving ? within(drive.uy, limit) : 0;
    if (estimator->read != NULL && b->estimate_every > 0u && --b->estimate_left == 0u) {
        b->estimate_left = b->estimate_every;
        memset(&b->estimate, 0, sizeof b->estimate);
        estimator->read(estimator->context, &b->estimate);
        b->estimate.tick = (uint32_t)b->tick;
        if (b->driving)
            b->estimate.flags = (uint16_t)(b->estimate.flags | HIL_ESTIMATE_FLAGS_DRIVING);
        b->estimate_due = true;
    }
    return b->driving && (codes[0] != drive.ux || codes[1] != drive.uy);
}

/* The drive that the codes just sampled lead to; true if it had to be limited. */
static bool close_loop(hil_board *b, int32_t vx, int32_t vy) {
    int32_t codes[2];
    bool limited = b->board_mode ? step_estimator(b, vx, vy, codes) : hil_gain_step(&b->gain, b->tick, vx, vy, codes);
    if (limited)
        hil_count(&b->saturated, 1u);
    hil_drive *drive = &b->computed[(uint64_t)(b->tick + (int64_t)b->config.identity.latency_ticks) % HIL_LATENCY];
    drive->ux = codes[0];
    drive->uy = codes[1];
    return limited;
}

/* Bring a sense code into the range of its converter; true if it had to be changed. */
static bool bounded(int32_t *code, int32_t most) {
    int32_t given = *code;
    if (given > most)
        *code = most;
    if (given < -most - 1)
        *code = -most - 1;
    return *code != given;
}

void hil_board_sample(hil_board *board, int32_t vx, int32_t vy, bool clipped) {
    if (!board->started)
        return;
    board->tick++;
    if (board->granted > 0u)
        board->granted--;
    if (!hil_board_streaming(board))
        return;
    clipped = bounded(&vx, board->sense_max) || clipped;
    clipped = bounded(&vy, board->sense_max) || clipped;
    uint8_t flags = board->interval_flags;
    if (clipped)
        flags |= HIL_SENSE_FLAGS_CLIPPED;
    if (self_driven(board) ? close_loop(board, vx, vy) : board->held.limited)
        flags |= HIL_SENSE_FLAGS_SATURATED;
    board->interval_flags = 0u;
    add_row(board, vx, vy, flags);
    if (board->status_every > 0u && --board->status_left == 0u) {
        board->status_left = board->status_every;
        board->status_due = true;
    }
}

hil_drive hil_board_drive(hil_board *board) {
    bool came = !self_driven(board) && take_command(board);
    if (self_driven(board) && hil_board_streaming(board))
        board->held.codes = board->computed[(uint64_t)board->tick % HIL_LATENCY];
    if (running(board)) {
        if (board->tick - board->fed >= (int64_t)board->watchdog) {
            hil_count(&board->trips, 1u);
            happen_here(board, HIL_EVENT_WATCHDOG);
        } else if (!self_driven(board) && board->tick == board->due) {
            board->due += (int64_t)board->block_rows;
            if (!came) {
                hil_count(&board->held_ticks, 1u);
                board->interval_flags |= HIL_SENSE_FLAGS_HELD;
            }
        }
    }
    return board->held.codes;
}

/* ------------------------------------------------------------------------------------------------ answers */

static void say_status(hil_board *b, reply *said) {
    hil_status status;
    uint32_t bad = b->config.link->bad(b->config.link);
    hil_count(&bad, b->undecodable);
    status.state = hil_board_state(b);
    status.reason = b->reason;
    status.late = b->late;
    status.held = b->held_ticks;
    status.bad_frames = bad;
    status.lost_seq = b->lost;
    status.saturated = b->saturated;
    status.watchdog_trips = b->trips;
    status.dropped = b->dropped;
    status.tick = tick_now(b);
    said->type = HIL_TYPE_STATUS;
    said->size = hil_pack_status(&status, said->payload);
}

static void say_register(hil_board *b, unsigned place, reply *said) {
    hil_register_value value = {hil_registers[place].id, b->registers.value[place]};
    said->type = HIL_TYPE_REGISTER_VALUE;
    said->size = hil_pack_register_value(&value, said->payload);
}

/* Each of these answers a message, or returns the reason why it is refused. */

static uint8_t hello(hil_board *b, const hil_hello *message, reply *said) {
    b->greeted = message->protocol == HIL_PROTOCOL && message->spec_hash == HIL_SPEC_HASH;
    (void)happen(b, b->greeted ? HIL_EVENT_HELLO : HIL_EVENT_HELLO_OTHER, HIL_SAFE_REASON_NONE);
    forget_blocks(b); /* the new host has not asked for them */
    said->type = HIL_TYPE_IDENTITY;
    said->size = hil_pack_identity(&b->config.identity, said->payload);
    return 0;
}

static uint8_t arm(hil_board *b, reply *said) {
    unsigned event = b->greeted ? HIL_EVENT_ARM : HIL_EVENT_ARM_UNGREETED;
    if (at(b, event)->refusal != 0u)
        return at(b, event)->refusal;
    if (!hil_board_streaming(b)) { /* or else the answer to the first one was lost on the way */
        if (b->config.identity.latency_ticks == 0u && !b->lockstep && !self_driven(b))
            return HIL_NACK_REASON_NOT_SUPPORTED;
        if (b->gain_mode && !hil_gain_stable(&b->registers))
            return HIL_NACK_REASON_OUT_OF_RANGE;
        (void)happen(b, event, HIL_SAFE_REASON_NONE);
        b->started = true;
        b->granted = 0u;
        count_down(b);
        hil_gain_start(&b->gain, &b->registers);
        hil_gain_obey(&b->gain, &b->registers, b->drive_limit);
        forget_drives(b);
        b->estimate_due = false;
        if (b->board_mode && b->config.estimator->start != NULL)
            b->config.estimator->start(b->config.estimator->context);
        grant(b);
    }
    say_status(b, said);
    return 0;
}

/* Whatever its number and its length. */
static void safe(hil_board *b, const hil_frame *frame, reply *said) {
    uint8_t reason = frame->size == HIL_SAFE_SIZE ? frame->payload[0] : HIL_SAFE_OTHER;
    unsigned bit = reason < 8u ? 1u << reason : 0u;
    bool passing = (bit & HIL_SAFE_PASSING) != 0u;
    if (!passing && !(bit & HIL_SAFE_LATCHING))
        reason = HIL_SAFE_OTHER;
    (void)happen(b, passing ? HIL_EVENT_SAFE_PASSING : HIL_EVENT_SAFE_LATCHING, reason);
    say_status(b, said);
}

/* A drive was taken: it feeds the watchdog. */
static void feed(hil_board *b, reply *said) {
    b->fed = b->tick;
    if (happen(b, HIL_EVENT_DRIVE, HIL_SAFE_REASON_NONE)->answer == HIL_TYPE_STATUS)
        say_status(b, said);
    grant(b);
}

static uint8_t drive_force(hil_board *b, const hil_drive_force *message, reply *said) {
    if (self_driven(b))
        return at(b, HIL_EVENT_DRIVE_OTHER)->refusal;
    if (at(b, HIL_EVENT_DRIVE)->refusal != 0u)
        return at(b, HIL_EVENT_DRIVE)->refusal;
    /* With a latency the present interval has begun and cannot be changed; without one it waits for this. */
    int64_t first_open = b->tick + (b->config.identity.latency_ticks > 0u ? 1 : 0);
    uint32_t ahead = message->effective_tick - (uint32_t)first_open;
    if (ahead >= HORIZON) {
        (void)happen(b, HIL_EVENT_DRIVE_LATE, HIL_SAFE_REASON_NONE);
        hil_count(&b->late, 1u);
        grant(b);
        return 0;
    }
    int32_t limit = (int32_t)b->drive_limit;
    hil_drive codes = {within(message->ux, limit), within(message->uy, limit)};
    bool limited = codes.ux != message->ux || codes.uy != message->uy;
    if (!put_command(b, first_open + (int64_t)ahead, codes, limited))
        return HIL_NACK_REASON_OUT_OF_RANGE;
    if (limited)
        hil_count(&b->saturated, 1u);
    if (!running(b))
        b->due = first_open + (int64_t)ahead;
    feed(b, said);
    return 0;
}

static uint8_t drive_gains(hil_board *b, const hil_drive_gains *message, reply *said) {
    if (!b->gain_mode)
        return at(b, HIL_EVENT_DRIVE_OTHER)->refusal;
    if (at(b, HIL_EVENT_DRIVE)->refusal != 0u)
        return at(b, HIL_EVENT_DRIVE)->refusal;
    if (!hil_gain_accepts(message))
        return HIL_NACK_REASON_OUT_OF_RANGE;
    int64_t following = b->tick + 1;
    uint32_t ahead = message->effective_tick - (uint32_t)following;
    if (ahead >= HORIZON) { /* has passed: better late than never */
        hil_count(&b->late, 1u);
        ahead = 0u;
    }
    hil_gain_put(&b->gain, message, following + (int64_t)ahead);
    feed(b, said);
    return 0;
}

static uint8_t drive_board(hil_board *b, const hil_drive_board *message, reply *said) {
    if (!b->board_mode)
        return at(b, HIL_EVENT_DRIVE_OTHER)->refusal;
    if (at(b, HIL_EVENT_DRIVE)->refusal != 0u)
        return at(b, HIL_EVENT_DRIVE)->refusal;
    if (message->drive > 1u)
        return HIL_NACK_REASON_OUT_OF_RANGE;
    b->driving = message->drive == 1u;
    feed(b, said);
    return 0;
}

/* The register's place; HIL_REGISTERS for none, and for one of an optional part that this board lacks. */
static unsigned place_of(const hil_board *b, uint16_t id) {
    unsigned place = hil_registers_find(id);
    if (place < HIL_REGISTERS && (hil_registers[place].optional & ~b->config.identity.capabilities) != 0u)
        return HIL_REGISTERS;
    if (place >= HIL_REGISTER_TRIM_0 + b->config.trim_count && place < HIL_REGISTER_TRIM_0 + HIL_TRIMS)
        return HIL_REGISTERS;
    return place;
}

static bool is_trim(unsigned place) {
    return place >= HIL_REGISTER_TRIM_0 && place < HIL_REGISTER_TRIM_0 + HIL_TRIMS;
}

/* Why a trim output may not be given a code now, 0 if it may. */
static uint8_t refuse_trim(const hil_board *b, unsigned output, double code) {
    const hil_trim_output *trim = &b->config.trims[output];
    if (code < (double)trim->lowest || code > (double)trim->highest)
        return HIL_NACK_REASON_OUT_OF_RANGE;
    return (int32_t)code != 0 && !hil_board_streaming(b) ? HIL_NACK_REASON_BAD_STATE : 0u;
}

static uint8_t trim_read(const hil_board *b, const hil_trim_read *message, reply *said) {
    hil_trim_output told = {0};
    told.name = "";
    if (message->output < b->config.trim_count)
        told = b->config.trims[message->output];
    told.output = message->output;
    told.outputs = (uint8_t)b->config.trim_count;
    said->type = HIL_TYPE_TRIM_OUTPUT;
    said->size = hil_pack_trim_output(&told, said->payload);
    return 0;
}

static uint8_t register_write(hil_board *b, const hil_register_write *message, reply *said) {
    unsigned place = place_of(b, message->register_);
    bool settled = at(b, HIL_EVENT_WRITE)->refusal == 0u;
    uint8_t reason = hil_registers_refuse(&b->registers, place, message->value, settled);
    if (reason != 0u)
        return reason;
    if (place == HIL_REGISTER_CLOCK_MODE && !(b->config.clocks & 1u << (unsigned)message->value))
        return HIL_NACK_REASON_NOT_SUPPORTED;
    if (place == HIL_REGISTER_LOOP_MODE && message->value > HIL_LOOP_MODE_GAIN && b->config.estimator == NULL)
        return HIL_NACK_REASON_NOT_SUPPORTED;
    if (place == HIL_REGISTER_BLOCK && message->value > (double)b->room_rows)
        return HIL_NACK_REASON_NOT_SUPPORTED;
    if (is_trim(place)) {
        unsigned output = place - HIL_REGISTER_TRIM_0;
        reason = refuse_trim(b, output, message->value);
        if (reason != 0u)
            return reason;
        b->config.put_trim(b->config.context, output, (int32_t)message->value);
    }
    b->registers.value[place] = message->value;
    registers_changed(b);
    if (place == HIL_REGISTER_DRIVE_LIMIT)
        limit_drives(b);
    say_register(b, place, said);
    return 0;
}

static uint8_t register_read(hil_board *b, const hil_register_read *message, reply *said) {
    unsigned place = place_of(b, message->register_);
    if (place >= HIL_REGISTERS)
        return HIL_NACK_REASON_UNKNOWN_REGISTER;
    say_register(b, place, said);
    return 0;
}

static uint8_t field_read(const hil_field_read *message, reply *said) {
    if (message->line >= HIL_FIELD_LINES)
        return HIL_NACK_REASON_OUT_OF_RANGE;
    const char *entry = hil_field_table[message->line];
    hil_field_value value = {message->line, HIL_FIELD_LINES, entry, strlen(entry)};
    said->type = HIL_TYPE_FIELD_VALUE;
    said->size = hil_pack_field_value(&value, said->payload);
    return 0;
}

static uint8_t time_sync(hil_board *b, const hil_time_sync *message, reply *said) {
    hil_time_sync value = *message;
    /* In lockstep the board's time is bench time, so that a record does not depend on the machine's speed. */
    value.board_ns = b->lockstep
                         ? (uint64_t)((double)tick_now(b) * 1e9 / b->config.identity.tick_rate_Hz + 0.5)
                         : b->config.now_ns(b->config.context);
    said->type = HIL_TYPE_TIME_SYNC;
    said->size = hil_pack_time_sync(&value, said->payload);
    return 0;
}

/* Account for a sequence number; false if the frame has been here before. */
static bool follows(hil_board *b, const hil_frame *frame) {
    if (frame->type == HIL_TYPE_HELLO)
        b->expecting = false;
    if (b->expecting && frame->seq != b->expected) {
        uint16_t behind = (uint16_t)(b->expected - frame->seq);
        if (behind <= REPEAT_WINDOW) {
            b->run = b->run > 0u && frame->seq == b->run_next ? (uint8_t)(b->run + 1u) : 1u;
            b->run_next = (uint16_t)(frame->seq + 1u);
            if (b->run < REPEAT_RUN) {
                hil_count(&b->repeated, 1u);
                return false;
            }
        } else {
            hil_count(&b->lost, (uint16_t)(frame->seq - b->expected));
        }
    }
    b->expecting = true;
    b->expected = (uint16_t)(frame->seq + 1u);
    b->run = 0u;
    return true;
}

/* Answer a message: 0, or the reason why it is refused. */
static uint8_t answer(hil_board *b, const hil_frame *frame, reply *said) {
    union {
        hil_hello hello;
        hil_drive_force drive_force;
        hil_drive_gains drive_gains;
        hil_drive_board drive_board;
        hil_register_read register_read;
        hil_register_write register_write;
        hil_field_read field_read;
        hil_time_sync time_sync;
        hil_trim_read trim_read;
    } message;
    const uint8_t *payload = frame->payload;
    size_t size = frame->size;
    switch (frame->type) {
    case HIL_TYPE_HELLO:
        return hil_unpack_hello(&message.hello, payload, size) ? hello(b, &message.hello, said)
                                                               : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_ARM:
        return size == HIL_ARM_SIZE ? arm(b, said) : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_DRIVE_FORCE:
        return hil_unpack_drive_force(&message.drive_force, payload, size)
                   ? drive_force(b, &message.drive_force, said)
                   : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_DRIVE_GAINS:
        return hil_unpack_drive_gains(&message.drive_gains, payload, size)
                   ? drive_gains(b, &message.drive_gains, said)
                   : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_DRIVE_BOARD:
        return hil_unpack_drive_board(&message.drive_board, payload, size)
                   ? drive_board(b, &message.drive_board, said)
                   : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_REGISTER_READ:
        return hil_unpack_register_read(&message.register_read, payload, size)
                   ? register_read(b, &message.register_read, said)
                   : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_REGISTER_WRITE:
        return hil_unpack_register_write(&message.register_write, payload, size)
                   ? register_write(b, &message.register_write, said)
                   : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_FIELD_READ:
        return hil_unpack_field_read(&message.field_read, payload, size)
                   ? field_read(&message.field_read, said)
                   : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_TIME_SYNC:
        return hil_unpack_time_sync(&message.time_sync, payload, size) ? time_sync(b, &message.time_sync, said)
                                                                       : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_TRIM_READ:
        if (b->config.trim_count == 0u)
            return HIL_NACK_REASON_UNKNOWN_TYPE;
        return hil_unpack_trim_read(&message.trim_read, payload, size) ? trim_read(b, &message.trim_read, said)
                                                                       : HIL_NACK_REASON_BAD_LENGTH;
    case HIL_TYPE_SENSE:
    case HIL_TYPE_STATUS:
    case HIL_TYPE_NACK:
    case HIL_TYPE_IDENTITY:
    case HIL_TYPE_REGISTER_VALUE:
    case HIL_TYPE_FIELD_VALUE:
        return HIL_NACK_REASON_NOT_SUPPORTED; /* what boards say, not hosts */
    default:
        return HIL_NACK_REASON_UNKNOWN_TYPE;
    }
}

/* ------------------------------------------------------------------------------------------------ sending */

/* Send, and spend its numbers even where there is no room: so the host sees that something is missing. */
static bool send(hil_board *b, uint8_t type, uint32_t tick, const uint8_t *payload, size_t size, uint16_t numbers) {
    hil_frame frame;
    frame.type = type;
    frame.sequenced = true;
    frame.seq = b->seq;
    b->seq = (uint16_t)(b->seq + numbers);
    frame.tick = tick;
    frame.payload = payload;
    frame.size = size;
    return b->config.link->send(b->config.link, &frame);
}

void hil_board_frame(hil_board *board, const hil_frame *frame) {
    reply said;
    said.type = 0u;
    said.size = 0u;
    lock(board, true);
    if (frame->type == HIL_TYPE_SAFE) {
        safe(board, frame, &said); /* stands outside the sequence */
    } else if (frame->sequenced && follows(board, frame)) {
        uint8_t reason = answer(board, frame, &said);
        if (reason == HIL_NACK_REASON_BAD_LENGTH || reason == HIL_NACK_REASON_UNKNOWN_TYPE)
            hil_count(&board->undecodable, 1u);
        bool optional = frame->type >= HIL_OPTIONAL_FIRST && frame->type <= HIL_OPTIONAL_LAST;
        if (reason != 0u && !optional) { /* optional ones that it does not take are counted and passed over */
            hil_nack nack = {frame->type, frame->seq, reason};
            said.type = HIL_TYPE_NACK;
            said.size = hil_pack_nack(&nack, said.payload);
        }
    }
    uint32_t tick = tick_now(board);
    lock(board, false);
    if (said.type != 0u)
        (void)send(board, said.type, tick, said.payload, said.size, 1u);
}

void hil_board_poll(hil_board *board) {
    lock(board, true);
    hil_block *block = &board->block[1u - board->filling];
    bool full = block->full;
    bool status_due = board->status_due;
    board->status_due = false;
    bool estimate_due = board->estimate_due;
    hil_estimate estimate = board->estimate;
    board->estimate_due = false;
    uint32_t tick = tick_now(board);
    lock(board, false);
    if (full) {
        hil_link *link = board->config.link;
        hil_sense head = {(uint16_t)block->rows, board->width, block->flags, block->matrix_id};
        (void)hil_pack_sense(&head, block->payload);
        bool sent = send(board, HIL_TYPE_SENSE, (uint32_t)block->tick, block->payload,
                         HIL_SENSE_SIZE + (size_t)block->rows * HIL_SENSE_COLUMNS * board->width,
                         link->numbers(link, block->rows, board->width));
        lock(board, true);
        block->full = false;
        if (!sent)
            hil_count(&board->dropped, 1u);
        board->seq = (uint16_t)(board->seq + board->skipped);
        board->skipped = 0u;
        lock(board, false);
    }
    if (status_due) {
        reply said;
        lock(board, true);
        say_status(board, &said);
        tick = tick_now(board);
        lock(board, false);
        (void)send(board, said.type, tick, said.payload, said.size, 1u);
    }
    if (estimate_due) {
        uint8_t payload[HIL_ESTIMATE_SIZE];
        size_t size = hil_pack_estimate(&estimate, payload);
        (void)send(board, HIL_TYPE_ESTIMATE, tick, payload, size, 1u);
    }
}
