/* Random bytes, damaged frames and senseless messages into everything that reads, for the sanitizers to watch.
 *
 *     fuzz [BYTES [SEED]]
 *
 * Prints what was fed and taken as one line of JSON. Exit code 1 if a frame was taken that nobody had sent, or a
 * board said something that is no frame, put out a drive beyond its limit or while it was not running, or streamed
 * without a matching HELLO.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hil_board.h"
#include "hil_can.h"
#include "hil_serial.h"

#define LONGEST 700u  /* payload of nearly all frames; now and then there is a longer one */
#define REMEMBERED 8u /* frames sent last: what is taken must be among them */
#define TICKS 40u     /* at most so many after each helping */

typedef struct chunk {
    uint8_t data[2u * HIL_MAX_ENCODED];
    size_t size;
} chunk;

/* Header and payload of a frame that was sent whole, or damaged on the way. */
typedef struct body {
    hil_frame head;
    uint8_t payload[HIL_MAX_PAYLOAD];
} body;

typedef struct bench {
    hil_board board;
    hil_serial serial;
    hil_can can;
    uint8_t blocks[HIL_BLOCKS_SIZE(64, 3)];
    hil_reader echo; /* reads what the board says */
    uint8_t echo_body[HIL_MAX_BODY];
    size_t room;
    bool on_can;
} bench;

static bench the; /* static, like everything here: the sanitizers watch globals as well */
static uint64_t state = 1;
static uint64_t helpings, sent, taken, corrupt, can_frames, answers, wrong;

static uint32_t chance(uint32_t below) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return below ? (uint32_t)(state >> 32) % below : 0u;
}

static uint8_t any(void) {
    return (uint8_t)chance(256);
}

/* -------------------------------------------------------------------------------------------------- helpings */

static body remembered[REMEMBERED];

static void add(void *context, const uint8_t *data, size_t size) {
    chunk *c = context;
    memcpy(c->data + c->size, data, size);
    c->size += size;
}

static const uint8_t types[] = {
    HIL_TYPE_SAFE,  HIL_TYPE_ARM,           HIL_TYPE_ARM,            HIL_TYPE_DRIVE_FORCE, HIL_TYPE_DRIVE_GAINS,
    HIL_TYPE_HELLO, HIL_TYPE_REGISTER_READ, HIL_TYPE_REGISTER_WRITE, HIL_TYPE_FIELD_READ,  HIL_TYPE_TIME_SYNC,
    HIL_TYPE_DRIVE_BOARD, HIL_TYPE_ESTIMATE,
};

/* A tick that is about to come, or has just passed; now and then any. */
static uint32_t soon(void) {
    return chance(20) ? (uint32_t)the.board.tick + chance(40) - 3u : chance(0xFFFFFFFFu);
}

/* A payload of the right length, with numbers that a host might send and some that none would. */
static size_t sensible(uint8_t type, uint8_t *payload) {
    static const double values[] = {0, 0, 0, 1, 1, 2, 3, 40, 64, 65, 682, 1e5, 16.0, -15.5, 0.3, 1e300, -1e300, 8388607};
    hil_hello hello = {HIL_PROTOCOL, chance(20) ? HIL_SPEC_HASH : 0u};
    hil_safe safe = {any()};
    hil_drive_force force = {(int32_t)chance(0xFFFFFFFFu), (int32_t)chance(2000) - 1000, soon()};
    hil_drive_gains gains = {any(), {0}, {0}, soon()};
    hil_drive_board permit = {(uint8_t)chance(3)};
    hil_register_read read = {(uint16_t)chance(0x34)};
    hil_register_write write = {(uint16_t)chance(0x34), values[chance(sizeof values / sizeof *values)]};
    hil_field_read field = {(uint16_t)chance(400)};
    hil_time_sync sync = {state, 0};
    switch (type) {
    case HIL_TYPE_HELLO:
        return hil_pack_hello(&hello, payload);
    case HIL_TYPE_SAFE:
        return hil_pack_safe(&safe, payload);
    case HIL_TYPE_DRIVE_FORCE:
        return hil_pack_drive_force(&force, payload);
    case HIL_TYPE_DRIVE_GAINS:
        for (unsigned k = 0; k < 40u; k++) /* any pattern of bits: infinities, numbers that are none */
            ((uint8_t *)(k < 32u ? (void *)gains.gain : (void *)gains.bias))[k % 32u] = any();
        if (chance(2))
            for (unsigned k = 0; k < 8u; k++)
                gains.gain[k] = ((float)chance(4000) - 2000.0f) * (k < 4u ? 1.0f : 1e-4f);
        if (chance(2))
            gains.bias[0] = gains.bias[1] = 12.5f;
        return hil_pack_drive_gains(&gains, payload);
    case HIL_TYPE_DRIVE_BOARD:
        return hil_pack_drive_board(&permit, payload);
    case HIL_TYPE_REGISTER_READ:
        return hil_pack_register_read(&read, payload);
    case HIL_TYPE_REGISTER_WRITE:
        return hil_pack_register_write(&write, payload);
    case HIL_TYPE_FIELD_READ:
        return hil_pack_field_read(&field, payload);
    case HIL_TYPE_TIME_SYNC:
        return hil_pack_time_sync(&sync, payload);
    default:
        return 0;
    }
}

/* A frame as somebody might send it; it is remembered. */
static const body *compose(void) {
    static uint16_t seq;
    body *b = &remembered[sent++ % REMEMBERED];
    b->head.type = chance(4) ? types[chance(sizeof types)] : any();
    b->head.sequenced = true;
    b->head.seq = chance(50) ? seq++ : (uint16_t)chance(0x10000);
    b->head.tick = chance(3) ? chance(5000) : chance(0xFFFFFFFFu);
    b->head.payload = b->payload;
    if (chance(4)) {
        b->head.size = sensible(b->head.type, b->payload);
    } else {
        b->head.size = chance(chance(10) ? 64u : chance(20) ? LONGEST : HIL_MAX_PAYLOAD + 1u);
        uint8_t most = chance(2) ? 255u : 2u; /* half of them full of zeros */
        for (size_t k = 0; k < b->head.size; k++)
            b->payload[k] = (uint8_t)chance(most + 1u);
    }
    return b;
}

static void flip(chunk *c) {
    for (unsigned k = chance(8) + 1u; k > 0 && c->size > 0; k--) {
        uint32_t place = chance((uint32_t)c->size * 8u);
        c->data[place / 8u] ^= (uint8_t)(1u << place % 8u);
    }
}

static void cut(chunk *c) {
    size_t at = chance((uint32_t)c->size), n = chance(6) + 1u;
    if (n > c->size - at)
        n = c->size - at;
    memmove(c->data + at, c->data + at + n, c->size - at - n);
    c->size -= n;
}

static void insert(chunk *c) {
    size_t at = chance((uint32_t)c->size), n = chance(6) + 1u;
    memmove(c->data + at + n, c->data + at, c->size - at);
    for (size_t k = 0; k < n; k++)
        c->data[at + k] = any();
    c->size += n;
}

static void fill(chunk *c) {
    static const uint8_t awkward[] = {0, 0, 1, 2, 3, 254, 255};
    uint32_t kind = chance(3);
    size_t size = chance(50) ? chance(600) : HIL_MAX_ENCODED - 150u + chance(300);
    for (c->size = 0; c->size < size; c->size++)
        c->data[c->size] = kind == 0   ? any()
                           : kind == 1 ? (uint8_t)(1u + chance(255)) /* one endless run */
                                       : awkward[chance(sizeof awkward)];
}

static void help(chunk *c) {
    uint32_t kind = chance(10);
    c->size = 0;
    helpings++;
    if (kind == 0) {
        fill(c);
        return;
    }
    hil_frame_write(&compose()->head, add, c);
    if (kind == 1) { /* the first half of one, the second of the next */
        c->size = chance((uint32_t)c->size);
        chunk second;
        second.size = 0;
        hil_frame_write(&compose()->head, add, &second);
        size_t from = chance((uint32_t)second.size);
        add(c, second.data + from, second.size - from);
    } else if (kind == 2) {
        cut(c);
    } else if (kind == 3) {
        insert(c);
    } else if (kind < 7) {
        flip(c);
    }
}

/* -------------------------------------------------------------------------------------------------- the board */

static size_t room(void *context) {
    return ((bench *)context)->room;
}

static void said(void *context, const uint8_t *data, size_t size) {
    bench *b = context;
    hil_frame frame;
    for (size_t k = 0; k < size; k++)
        answers += hil_reader_take(&b->echo, data[k], &frame);
    wrong += hil_reader_bad(&b->echo) > 0u;
}

static void said_on_can(void *context, const hil_can_frame *frame) {
    (void)context;
    bool legal = false;
    for (unsigned k = 0; k < HIL_CAN_LENGTHS; k++)
        legal = legal || frame->length == hil_can_lengths[k];
    answers++;
    wrong += !legal || !(frame->identifier & 1u) || (!frame->fd && frame->length > 8u);
}

static uint64_t time_ns(void *context) {
    (void)context;
    return state;
}

/* An estimator that asks for any drive and estimates any number. */
static hil_drive step(void *context, int64_t tick, int32_t vx, int32_t vy, hil_drive held, bool drive) {
    (void)context;
    (void)tick;
    (void)vx;
    (void)vy;
    (void)held;
    (void)drive;
    hil_drive asked = {(int32_t)chance(0xFFFFFFFFu), (int32_t)chance(0xFFFFFFFFu)};
    return asked;
}

static void estimate(void *context, hil_estimate *out) {
    (void)context;
    uint8_t *bytes = (uint8_t *)out;
    for (size_t k = 0; k < sizeof *out; k++)
        bytes[k] = any();
}

static const hil_estimator estimator = {NULL, step, estimate, NULL};

static void power_up(bench *b) {
    hil_config config;
    memset(&config, 0, sizeof config);
    config.identity.tick_rate_Hz = 4000.0;
    config.identity.sense_bits = chance(2) ? 16u : 24u;
    config.identity.drive_bits = (uint8_t)(2u + chance(23));
    config.identity.latency_ticks = (uint16_t)chance(HIL_LATENCY);
    config.clocks = 7u;
    config.blocks = b->blocks;
    config.blocks_size = sizeof b->blocks;
    config.now_ns = time_ns;
    config.estimator = chance(2) ? &estimator : NULL;
    b->on_can = chance(2);
    b->room = 1u << 20;
    hil_reader_init(&b->echo, b->echo_body, sizeof b->echo_body);
    hil_serial_init(&b->serial, room, said, b);
    hil_can_init(&b->can, (uint8_t)chance(HIL_CAN_NODES), room, said_on_can, b);
    config.link = b->on_can ? &b->can.link : &b->serial.link;
    if (!hil_board_init(&b->board, &config))
        abort();
    if (chance(2)) { /* chance alone would seldom bring it into gain or board mode */
        uint8_t payload[HIL_MAX_HOST_PAYLOAD];
        hil_hello hello = {HIL_PROTOCOL, HIL_SPEC_HASH};
        hil_register_write gain = {hil_registers[HIL_REGISTER_LOOP_MODE].id, config.estimator != NULL && chance(2) ? HIL_LOOP_MODE_BOARD : HIL_LOOP_MODE_GAIN};
        hil_frame frame = {HIL_TYPE_HELLO, true, 0, 0, payload, hil_pack_hello(&hello, payload)};
        hil_board_frame(&b->board, &frame);
        frame.type = HIL_TYPE_REGISTER_WRITE;
        frame.seq++;
        frame.size = hil_pack_register_write(&gain, payload);
        hil_board_frame(&b->board, &frame);
    }
}

static void let_it_tick(bench *b) {
    for (unsigned n = chance(TICKS); n > 0; n--) {
        if (hil_board_lockstep(&b->board) && !hil_board_may_go_on(&b->board))
            break;
        hil_drive drive = hil_board_drive(&b->board);
        int32_t most = (int32_t)b->board.drive_limit; /* at once, also for what was held or waited */
        wrong += hil_board_state(&b->board) != HIL_STATE_RUNNING && (drive.ux != 0 || drive.uy != 0);
        wrong += drive.ux > most || drive.ux < -most || drive.uy > most || drive.uy < -most;
        uint32_t range = chance(4) ? 200u : 0xFFFFFFFFu;
        hil_board_sample(&b->board, (int32_t)chance(range), (int32_t)chance(range), chance(2));
        if (!chance(8))
            hil_board_poll(&b->board);
    }
    b->room = chance(10) ? 1u << 20 : chance(100);
    if (!chance(500))
        hil_board_safe(&b->board, HIL_SAFE_REASON_FAULT);
    if (!chance(50))
        hil_board_fault_gone(&b->board);
    wrong += hil_board_streaming(&b->board) && !b->board.greeted;
}

/* The same bytes as CAN frames, mostly with an identifier that the board listens to. */
static void as_can_frames(bench *b, const chunk *c) {
    for (size_t at = 0; at < c->size;) {
        hil_can_frame frame;
        frame.identifier = (uint16_t)(hil_can_match(&b->can) | types[chance(sizeof types)] << HIL_CAN_TYPE_SHIFT);
        if (!chance(10))
            frame.identifier = (uint16_t)chance(0x800);
        frame.fd = chance(4);
        frame.length = chance(20) ? hil_can_lengths[chance(HIL_CAN_LENGTHS)] : any();
        memset(frame.data, 0, sizeof frame.data);
        size_t n = c->size - at < HIL_CAN_MOST ? c->size - at : HIL_CAN_MOST;
        memcpy(frame.data, c->data + at, n);
        if (chance(3)) { /* a header that goes with its length */
            hil_can_part part = {(uint16_t)chance(4), 0, (uint8_t)chance(57), (uint8_t)chance(4)};
            (void)hil_pack_can_part(&part, frame.data);
        }
        hil_can_receive(&b->can, &b->board, &frame);
        can_frames++;
        at += n;
    }
}

/* A whole message as its CAN frame, so that boards on CAN come to life, too. */
static void in_one_can_frame(bench *b, const body *what) {
    hil_can_frame frame;
    hil_can_part part = {what->head.seq, what->head.tick, (uint8_t)what->head.size, 0};
    hil_can_arm arm = {what->head.seq, what->head.tick};
    if (what->head.size > HIL_CAN_MOST - HIL_CAN_PART_SIZE)
        return;
    memset(&frame, 0, sizeof frame);
    frame.identifier = (uint16_t)((what->head.type << HIL_CAN_TYPE_SHIFT & 0x7FF) | hil_can_match(&b->can));
    size_t size = HIL_CAN_PART_SIZE + what->head.size;
    (void)hil_pack_can_part(&part, frame.data);
    memcpy(frame.data + HIL_CAN_PART_SIZE, what->payload, what->head.size);
    if (what->head.type == HIL_TYPE_ARM)
        size = hil_pack_can_arm(&arm, frame.data);
    unsigned k = 0;
    while (hil_can_lengths[k] < size)
        k++;
    frame.fd = what->head.type != HIL_TYPE_ARM;
    frame.length = hil_can_lengths[k];
    hil_can_receive(&b->can, &b->board, &frame);
    can_frames++;
}

/* ---------------------------------------------------------------------------------------------------- judging */

static bool was_sent(const hil_frame *f) {
    for (unsigned k = 0; k < REMEMBERED; k++) {
        const hil_frame *s = &remembered[k].head;
        if (s->sequenced && f->type == s->type && f->seq == s->seq && f->tick == s->tick && f->size == s->size &&
            !memcmp(f->payload, s->payload, f->size))
            return true;
    }
    return false;
}

int main(int argc, char **argv) {
    static chunk c;
    static uint8_t everything[HIL_MAX_BODY];
    static uint8_t beginning[HIL_SERIAL_ROOM]; /* as much as a board keeps; behind it nothing may be touched */
    hil_reader reader, brief;
    uint64_t bytes = argc > 1 ? strtoull(argv[1], NULL, 10) : 1000000u, fed = 0;
    state = (argc > 2 ? strtoull(argv[2], NULL, 10) : 1u) * 0x9E3779B97F4A7C15u | 1u;
    hil_reader_init(&reader, everything, sizeof everything);
    hil_reader_init(&brief, beginning, sizeof beginning);
    power_up(&the);
    while (fed < bytes) {
        hil_frame frame;
        if (!chance(300))
            power_up(&the);
        help(&c);
        for (size_t k = 0; k < c.size; k++) {
            if (hil_reader_take(&reader, c.data[k], &frame)) {
                taken++;
                corrupt += !was_sent(&frame);
            }
            (void)hil_reader_take(&brief, c.data[k], &frame);
        }
        fed += c.size;
        if (the.on_can) {
            as_can_frames(&the, &c);
            in_one_can_frame(&the, compose());
        } else {
            hil_serial_receive(&the.serial, &the.board, c.data, c.size);
        }
        let_it_tick(&the);
        hil_board_poll(&the.board);
    }
    wrong += brief.frames != reader.frames;
    uint64_t checked = (uint64_t)reader.frames + reader.crc_errors;
    printf("{\"bytes\": %llu, \"runs\": %llu, \"taken\": %llu, \"corrupt\": %llu, \"checked\": %llu, "
           "\"can_frames\": %llu, \"answers\": %llu, \"wrong\": %llu}\n",
           (unsigned long long)fed, (unsigned long long)(checked + reader.cobs_errors + reader.too_short),
           (unsigned long long)taken, (unsigned long long)corrupt, (unsigned long long)checked,
           (unsigned long long)can_frames, (unsigned long long)answers, (unsigned long long)wrong);
    return corrupt > 0 || wrong > 0;
}
