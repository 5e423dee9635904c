/* Frames of CAN FD, and classic ones, as hil/wire/can_format.py has them. */

#ifndef TURN_CAN_H
#define TURN_CAN_H

#include "receive.h"

#define RECORD_HEAD 8u /* identifier, number of data bytes, flags */
#define CAN_BRS 0x01u
#define CAN_FDF 0x04u

/* The legal number of data bytes for so many, HIL_CAN_MOST at most. */
static uint8_t legal(size_t size)
{
    size_t k = 0;
    while (hil_can_lengths[k] < size)
        k++;
    return hil_can_lengths[k];
}

static uint32_t identifier_of(const can_t *can, unsigned type, unsigned sender)
{
    return (uint32_t)(type << HIL_CAN_TYPE_SHIFT | (unsigned)can->node << HIL_CAN_NODE_SHIFT | sender);
}

static bool take_can_rows(receiver_t *rx, can_t *can, batch_t *batch, const uint8_t *body, size_t length)
{
    hil_can_rows head;
    if (!hil_unpack_can_rows(&head, body, length))
        return false;
    uint8_t width = head.wide ? 3u : 2u;
    size_t size = (size_t)head.n * width * HIL_SENSE_COLUMNS, end = HIL_CAN_ROWS_SIZE + size;
    if (head.n == 0u || end > HIL_CAN_MOST || legal(end) != length)
        return false;
    hil_sense block = {.n = head.n, .width = width, .flags = head.flags, .matrix_id = head.matrix_id};
    uint8_t payload[HIL_SENSE_SIZE + HIL_CAN_MOST];
    hil_pack_sense(&block, payload);
    memcpy(payload + HIL_SENSE_SIZE, body + HIL_CAN_ROWS_SIZE, size);
    can->frames++;
    take_frame(rx, batch, HIL_TYPE_SENSE, head.seq, head.tick, payload, HIL_SENSE_SIZE + size);
    return true;
}

/* A part of a message, which is taken once its last part is there. */
static bool take_part(receiver_t *rx, can_t *can, batch_t *batch, uint8_t type, const uint8_t *body, size_t length)
{
    hil_can_part head;
    if (!hil_unpack_can_part(&head, body, length) || head.size > PART_ROOM ||
        legal(HIL_CAN_PART_SIZE + head.size) != length)
        return false;
    const uint8_t *payload = body + HIL_CAN_PART_SIZE;
    int64_t message = (int64_t)type << 16 | head.seq, at = (int64_t)head.part * PART_ROOM;
    bool last = head.size < PART_ROOM;
    if (can->unfinished == message && at == can->joined) {
        memcpy(can->parts + can->joined, payload, head.size);
        can->joined += head.size;
        if (!last)
            return true;
        can->unfinished = NONE;
        if (can->joined > (int64_t)HIL_MAX_PAYLOAD)
            return false;
        can->frames++;
        take_frame(rx, batch, type, head.seq, head.tick, can->parts, (size_t)can->joined);
        return true;
    }
    if (can->unfinished != NONE) {
        bool again = can->unfinished == message && at < can->joined;
        if (again && (at > 0 || (!last && memcmp(payload, can->parts, PART_ROOM) == 0))) /* repeated */
            return true;
        can->broken++;
        can->unfinished = NONE;
    }
    if (at > 0) /* the rest of a message that was counted, or whose loss the sequence shows */
        return true;
    if (last) {
        can->frames++;
        take_frame(rx, batch, type, head.seq, head.tick, payload, head.size);
    } else {
        can->unfinished = message;
        can->joined = head.size;
        memcpy(can->parts, payload, head.size);
    }
    return true;
}

/* SAFE counts whatever it looks like: a whole frame, or one cut short after the reason. */
static bool take_safe(receiver_t *rx, can_t *can, batch_t *batch, const uint8_t *body, size_t length, bool fd)
{
    hil_can_safe said = {0};
    size_t size = !fd && (length == 1u || length == HIL_CAN_SAFE_SIZE) ? 1u : 0u;
    if (size != 0u)
        (void)hil_unpack_can_safe(&said, body, length);
    can->frames++;
    take_frame(rx, batch, HIL_TYPE_SAFE, said.seq, said.tick, body, size);
    return true;
}

/* One record; other traffic on the bus is passed over. */
static void feed_record(receiver_t *rx, can_t *can, batch_t *batch, const uint8_t record[RECORD_SIZE])
{
    const uint8_t *body = record + RECORD_HEAD;
    uint32_t identifier;
    memcpy(&identifier, record, sizeof identifier);
    size_t length = record[4];
    uint8_t type = (uint8_t)(identifier >> HIL_CAN_TYPE_SHIFT & 0x7Fu);
    can->bytes += RECORD_SIZE;
    if (identifier != identifier_of(can, type, 1u) || type == HIL_TYPE_STATUS_BRIEF)
        return;
    bool taken;
    if (type == HIL_TYPE_SAFE)
        taken = take_safe(rx, can, batch, body, length, (record[5] & CAN_FDF) != 0u);
    else if (length > HIL_CAN_MOST)
        taken = false;
    else if (type == HIL_TYPE_SENSE)
        taken = take_can_rows(rx, can, batch, body, length);
    else if (type == HIL_TYPE_ARM) {
        hil_can_arm said;
        taken = length == HIL_CAN_ARM_SIZE && hil_unpack_can_arm(&said, body, length);
        if (taken) {
            can->frames++;
            take_frame(rx, batch, type, said.seq, said.tick, body, 0u);
        }
    } else
        taken = take_part(rx, can, batch, type, body, length);
    can->malformed += !taken;
}

/* Whole records. */
static void feed_records(receiver_t *rx, can_t *can, batch_t *batch, const uint8_t *data, size_t size)
{
    for (size_t at = 0; at + RECORD_SIZE <= size; at += RECORD_SIZE)
        feed_record(rx, can, batch, data + at);
}

/* A message of the host, each of which fits into one frame, as a record. */
static size_t record_of(const can_t *can, uint8_t type, uint16_t seq, uint32_t tick, const uint8_t *payload,
                        size_t size, uint8_t record[RECORD_SIZE])
{
    hil_can_part head = {.seq = seq, .tick = tick, .size = (uint8_t)size, .part = 0u};
    uint32_t identifier = identifier_of(can, type, 0u);
    memset(record, 0, RECORD_SIZE);
    memcpy(record, &identifier, sizeof identifier);
    record[4] = legal(HIL_CAN_PART_SIZE + size);
    record[5] = CAN_BRS | CAN_FDF;
    hil_pack_can_part(&head, record + RECORD_HEAD);
    memcpy(record + RECORD_HEAD + HIL_CAN_PART_SIZE, payload, size);
    return RECORD_SIZE;
}

#endif
