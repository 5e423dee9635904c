#include "hil_can.h"

#include <string.h>

#define ROOM (HIL_CAN_MOST - HIL_CAN_PART_SIZE)
#define BOARD 1u

uint16_t hil_can_match(const hil_can *can) {
    return (uint16_t)((unsigned)can->node << HIL_CAN_NODE_SHIFT); /* from the host: the lowest bit is 0 */
}

uint16_t hil_can_mask(void) {
    return (1u << HIL_CAN_TYPE_SHIFT) - 1u;
}

/* The legal number of data bytes that holds so many. */
static uint8_t legal(size_t bytes) {
    unsigned k = 0;
    while (hil_can_lengths[k] < bytes)
        k++;
    return hil_can_lengths[k];
}

/* ------------------------------------------------------------------------------------------------ sending */

static size_t rows_per_frame(unsigned width) {
    return ROOM / (HIL_SENSE_COLUMNS * width);
}

static uint16_t numbers(const hil_link *link, uint32_t rows, unsigned width) {
    (void)link;
    size_t most = rows_per_frame(width);
    return (uint16_t)((rows + most - 1u) / most);
}

static void start(const hil_can *can, hil_can_frame *out, uint8_t type, bool fd) {
    memset(out, 0, sizeof *out);
    out->identifier = (uint16_t)((unsigned)type << HIL_CAN_TYPE_SHIFT | (unsigned)can->node << HIL_CAN_NODE_SHIFT | BOARD);
    out->fd = fd;
}

static void send_rows(hil_can *can, const hil_frame *frame) {
    hil_sense sense;
    hil_can_frame out;
    if (!hil_unpack_sense(&sense, frame->payload, frame->size))
        return;
    size_t row = HIL_SENSE_COLUMNS * (size_t)sense.width, most = rows_per_frame(sense.width);
    const uint8_t *at = frame->payload + HIL_SENSE_SIZE;
    uint16_t seq = frame->seq;
    for (size_t first = 0; first < sense.n; first += most) {
        size_t n = sense.n - first < most ? sense.n - first : most;
        hil_can_rows head = {seq++, frame->tick + (uint32_t)first, (uint8_t)n, sense.width == 3u, sense.flags,
                             sense.matrix_id};
        start(can, &out, HIL_TYPE_SENSE, true);
        (void)hil_pack_can_rows(&head, out.data);
        memcpy(out.data + HIL_CAN_ROWS_SIZE, at + first * row, n * row);
        out.length = legal(HIL_CAN_ROWS_SIZE + n * row);
        can->put(can->context, &out);
    }
}

static void send_parts(hil_can *can, const hil_frame *frame) {
    hil_can_frame out;
    size_t at = 0, size;
    uint8_t part = 0;
    do { /* parts are full up to the last, which is not, if only because it is empty */
        size = frame->size - at < ROOM ? frame->size - at : ROOM;
        hil_can_part head = {frame->seq, frame->tick, (uint8_t)size, part++};
        start(can, &out, frame->type, true);
        (void)hil_pack_can_part(&head, out.data);
        memcpy(out.data + HIL_CAN_PART_SIZE, frame->payload + at, size);
        out.length = legal(HIL_CAN_PART_SIZE + size);
        can->put(can->context, &out);
        at += size;
    } while (size == ROOM);
}

static uint8_t brief(uint32_t counter) {
    return counter > 0xFFu ? 0xFFu : (uint8_t)counter;
}

/* For nodes that hear classic CAN only. */
static void send_brief(hil_can *can, const hil_frame *frame) {
    hil_status status;
    hil_can_frame out;
    if (!hil_unpack_status(&status, frame->payload, frame->size))
        return;
    hil_can_status_brief said = {status.state, status.reason, brief(status.lost_seq), brief(status.watchdog_trips),
                                 status.tick};
    start(can, &out, HIL_TYPE_STATUS_BRIEF, false);
    out.length = (uint8_t)hil_pack_can_status_brief(&said, out.data);
    can->put(can->context, &out);
}

static bool send(hil_link *link, const hil_frame *frame) {
    hil_can *can = (hil_can *)link; /* its first member */
    size_t needed = frame->size / ROOM + 1u;
    if (frame->type == HIL_TYPE_SENSE)
        needed = numbers(link, frame->payload[0] | (uint32_t)frame->payload[1] << 8, frame->payload[2]);
    if (frame->type == HIL_TYPE_STATUS)
        needed++;
    if (can->free(can->context) < needed)
        return false;
    if (frame->type == HIL_TYPE_SENSE)
        send_rows(can, frame);
    else
        send_parts(can, frame);
    if (frame->type == HIL_TYPE_STATUS)
        send_brief(can, frame);
    return true;
}

static uint32_t bad(const hil_link *link) {
    const hil_can *can = (const hil_can *)link;
    uint32_t sum = can->malformed;
    hil_count(&sum, can->broken);
    return sum;
}

void hil_can_init(hil_can *can, uint8_t node, size_t (*free)(void *context),
                  void (*put)(void *context, const hil_can_frame *frame), void *context) {
    memset(can, 0, sizeof *can);
    can->link.send = send;
    can->link.numbers = numbers;
    can->link.bad = bad;
    can->node = node;
    can->free = free;
    can->put = put;
    can->context = context;
}

/* ---------------------------------------------------------------------------------------------- receiving */

static void give(hil_board *board, uint8_t type, bool sequenced, uint16_t seq, uint32_t tick, const uint8_t *payload,
                 size_t size) {
    hil_frame frame;
    frame.type = type;
    frame.sequenced = sequenced;
    frame.seq = seq;
    frame.tick = tick;
    frame.payload = payload;
    frame.size = size;
    hil_board_frame(board, &frame);
}

/* Any node may stop the board, also one that keeps no count. */
static void receive_safe(hil_board *board, const hil_can_frame *in) {
    uint8_t unsaid = HIL_SAFE_REASON_HOST_REQUEST;
    bool said = !in->fd && (in->length == 1u || in->length == HIL_CAN_SAFE_SIZE);
    give(board, HIL_TYPE_SAFE, false, 0u, 0u, said ? in->data : &unsaid, 1u);
}

static bool receive_arm(hil_board *board, const hil_can_frame *in) {
    hil_can_arm arm;
    if (!hil_unpack_can_arm(&arm, in->data, in->length))
        return false;
    give(board, HIL_TYPE_ARM, true, arm.seq, arm.tick, in->data, 0u);
    return true;
}

/* SENSE, which no host sends: an intact one is for the board to refuse. */
static bool receive_rows(hil_board *board, const hil_can_frame *in) {
    hil_can_rows head;
    if (!hil_unpack_can_rows(&head, in->data, in->length))
        return false;
    size_t end = HIL_CAN_ROWS_SIZE + (size_t)head.n * HIL_SENSE_COLUMNS * (head.wide ? 3u : 2u);
    if (head.n == 0u || end > HIL_CAN_MOST || legal(end) != in->length)
        return false;
    give(board, HIL_TYPE_SENSE, true, head.seq, head.tick, in->data + HIL_CAN_ROWS_SIZE, end - HIL_CAN_ROWS_SIZE);
    return true;
}

/* Whether a part is one of those that are there, come again. A first part that differs from the one there, which was a
 * full one, is that of another message. */
static bool repeated(const hil_can *can, const hil_can_part *head, const uint8_t *payload) {
    if (head->part > 0u)
        return head->part < can->parts;
    size_t kept = ROOM < sizeof can->payload ? ROOM : sizeof can->payload;
    return head->size == ROOM && memcmp(can->payload, payload, kept) == 0;
}

/* Take a part in; true once the message is whole. */
static bool join(hil_can *can, uint8_t type, const hil_can_part *head, const uint8_t *payload) {
    bool same = type == can->type && head->seq == can->seq;
    if (can->joining && same && repeated(can, head, payload))
        return false;
    if (can->joining && !(same && head->part == can->parts)) {
        hil_count(&can->broken, 1u);
        can->joining = false;
    }
    if (!can->joining) {
        if (head->part > 0u)
            return false; /* the rest of a message that was counted, or whose loss the sequence shows */
        can->joining = true;
        can->type = type;
        can->seq = head->seq;
        can->parts = 0u;
        can->size = 0u;
    }
    if (can->size < sizeof can->payload) {
        size_t room = sizeof can->payload - can->size;
        memcpy(can->payload + can->size, payload, head->size < room ? head->size : room);
    }
    can->size += head->size;
    can->parts++;
    if (head->size == ROOM && can->size <= HIL_MAX_PAYLOAD)
        return false;
    can->joining = false;
    if (can->size > HIL_MAX_PAYLOAD) {
        hil_count(&can->malformed, 1u);
        return false;
    }
    return true;
}

static bool receive_part(hil_can *can, hil_board *board, uint8_t type, const hil_can_frame *in) {
    hil_can_part head;
    if (!hil_unpack_can_part(&head, in->data, in->length) || head.size > ROOM ||
        legal(HIL_CAN_PART_SIZE + (size_t)head.size) != in->length)
        return false;
    if (join(can, type, &head, in->data + HIL_CAN_PART_SIZE))
        give(board, type, true, head.seq, head.tick, can->payload, can->size);
    return true;
}

void hil_can_receive(hil_can *can, hil_board *board, const hil_can_frame *frame) {
    uint8_t type = (uint8_t)(frame->identifier >> HIL_CAN_TYPE_SHIFT);
    bool good = true;
    if ((frame->identifier & hil_can_mask()) != hil_can_match(can) || frame->length > HIL_CAN_MOST)
        return;
    if (type == HIL_TYPE_STATUS_BRIEF)
        return; /* has no place in the sequence, and no host sends it */
    if (type == HIL_TYPE_SAFE)
        receive_safe(board, frame);
    else if (type == HIL_TYPE_ARM)
        good = receive_arm(board, frame);
    else if (type == HIL_TYPE_SENSE)
        good = receive_rows(board, frame);
    else
        good = receive_part(can, board, type, frame);
    if (!good)
        hil_count(&can->malformed, 1u);
}
