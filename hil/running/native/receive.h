/* Bytes in, samples and messages out: what hil.wire.stream.Receiver does on the host's end, with the same counters. */

#ifndef TURN_RECEIVE_H
#define TURN_RECEIVE_H

#include "structs.h"

#define REPEAT_WINDOW 256 /* hil.wire.stream has these two */
#define REPEAT_RUN 4
#define MOST_ROWS ((HIL_MAX_ENCODED + READ_SIZE) / 8u + 1u) /* of one `feed` */
#define MOST_SAID 65536                                     /* bytes of messages of one `feed` */

static int64_t unwrap(uint32_t low, int64_t near)
{
    int64_t tick = near + (int32_t)(low - (uint32_t)near);
    return tick >= 0 ? tick : (int64_t)low;
}

/* Whether a frame that looks repeated is the last of a run that shows where the peer really is. */
static bool moves_back(receiver_t *rx, int64_t seq)
{
    rx->run = rx->run != 0 && seq == rx->run_next ? rx->run + 1 : 1;
    rx->run_next = (seq + 1) & 0xFFFF;
    return rx->run >= REPEAT_RUN;
}

/* Account for a sequence number; false if the frame has been here before. */
static bool follows(receiver_t *rx, int64_t seq)
{
    if (rx->expected != NONE && seq != rx->expected) {
        if (((rx->expected - seq) & 0xFFFF) > REPEAT_WINDOW) {
            rx->lost += (seq - rx->expected) & 0xFFFF;
        } else if (!moves_back(rx, seq)) {
            rx->repeated++;
            return false;
        }
    }
    rx->expected = (seq + 1) & 0xFFFF;
    rx->run = 0;
    return true;
}

static void say(batch_t *batch, int type, int seq, int64_t tick, const uint8_t *payload, size_t size)
{
    said_t said = {.tick = tick, .type = type, .seq = seq, .size = (int32_t)size};
    memcpy(batch->said + batch->said_size, &said, sizeof said);
    batch->said_size += (int64_t)sizeof said;
    memcpy(batch->said + batch->said_size, payload, size);
    batch->said_size += (int64_t)((size + 7u) & ~(size_t)7u);
}

static uint32_t little(const uint8_t *from, unsigned size)
{
    uint32_t value = 0;
    for (unsigned k = 0; k < size; k++)
        value |= (uint32_t)from[k] << (8u * k);
    return value;
}

/* Rows of a SENSE; false if it contradicts itself. */
static bool sense(batch_t *batch, int64_t tick, const uint8_t *payload, size_t size)
{
    hil_sense head;
    if (!hil_unpack_sense(&head, payload, size) || (head.width != 2u && head.width != 3u) || head.n < 1u ||
        size != HIL_SENSE_SIZE + (size_t)head.n * head.width * HIL_SENSE_COLUMNS)
        return false;
    const uint8_t *at = payload + HIL_SENSE_SIZE;
    unsigned shift = 32u - 8u * head.width;
    for (unsigned k = 0; k < head.n; k++) {
        row_t *row = &batch->rows[batch->row_count++];
        row->tick = tick + k;
        for (unsigned column = 0; column < HIL_SENSE_COLUMNS; column++, at += head.width)
            row->codes[column] = (int32_t)(little(at, head.width) << shift) >> shift;
        row->flags = head.flags;
        row->matrix = head.matrix_id;
        row->left = (int16_t)(head.n - k);
    }
    return true;
}

static bool known(const batch_t *batch, uint8_t type, size_t size)
{
    int32_t expected = batch->sizes[type];
    if (expected >= OPEN_ENDED)
        return size >= (size_t)(expected - OPEN_ENDED);
    return expected >= 0 && size == (size_t)expected;
}

/* An intact frame. */
static void take_frame(receiver_t *rx, batch_t *batch, uint8_t type, uint16_t seq, uint32_t tick,
                       const uint8_t *payload, size_t size)
{
    int64_t before = rx->tick;
    if (type == HIL_TYPE_SAFE) { /* stands outside of all this */
        uint8_t otherwise = HIL_SAFE_REASON_HOST_REQUEST;
        say(batch, type, seq, before, size == HIL_SAFE_SIZE ? payload : &otherwise, HIL_SAFE_SIZE);
        return;
    }
    if (type == HIL_TYPE_HELLO || type == HIL_TYPE_IDENTITY)
        rx->expected = NONE;
    if (!follows(rx, seq))
        return;
    rx->tick = unwrap(tick, before);
    if (type == HIL_TYPE_SENSE ? sense(batch, rx->tick, payload, size) : known(batch, type, size)) {
        if (type != HIL_TYPE_SENSE)
            say(batch, type, seq, rx->tick, payload, size);
        return;
    }
    rx->tick = before; /* of what is not understood, the tick is not believed either */
    if (type >= HIL_OPTIONAL_FIRST && type <= HIL_OPTIONAL_LAST && batch->sizes[type] < 0)
        rx->passed_over++;
    else
        rx->undecodable++;
}

/* A run of bytes between two delimiters. */
static void take_run(receiver_t *rx, batch_t *batch, const uint8_t *run, size_t size)
{
    hil_reader reader;
    hil_frame frame;
    uint8_t body[HIL_MAX_BODY];
    hil_reader_init(&reader, body, sizeof body);
    for (size_t k = 0; k < size; k++)
        (void)hil_reader_take(&reader, run[k], &frame);
    if (hil_reader_take(&reader, 0, &frame)) {
        rx->frames++;
        take_frame(rx, batch, frame.type, frame.seq, frame.tick, frame.payload, frame.size);
        return;
    }
    rx->cobs_errors += reader.cobs_errors;
    rx->too_short += reader.too_short;
    rx->crc_errors += reader.crc_errors;
    rx->oversize += reader.oversize;
    rx->dropped_bytes += (int64_t)size;
}

/* Take `size` bytes, READ_SIZE at most, that stand in `rest` behind what is held there. */
static void feed(receiver_t *rx, batch_t *batch, size_t size)
{
    uint8_t *begin = rx->rest, *fresh = begin + rx->held, *end = fresh + size, *zero;
    rx->bytes += (int64_t)size;
    if (rx->skipping) {
        zero = memchr(begin, 0, size);
        rx->dropped_bytes += zero == NULL ? (int64_t)size : zero - begin;
        if (zero == NULL)
            return;
        rx->skipping = 0;
        begin = fresh = zero + 1;
    }
    while ((zero = memchr(fresh, 0, (size_t)(end - fresh))) != NULL) {
        if (zero > begin)
            take_run(rx, batch, begin, (size_t)(zero - begin));
        begin = fresh = zero + 1;
    }
    size_t left = (size_t)(end - begin);
    if (left > HIL_MAX_ENCODED) {
        rx->oversize++;
        rx->dropped_bytes += (int64_t)left;
        rx->skipping = 1;
        left = 0;
    }
    memmove(rx->rest, begin, left);
    rx->held = (int64_t)left;
}

/* Whether there is room for what one `feed` may bring. */
static bool has_room(const batch_t *batch)
{
    return batch->row_room - batch->row_count >= (int64_t)MOST_ROWS && batch->said_room - batch->said_size >= MOST_SAID;
}

#endif
