#include "hil_frame.h"

#include "hil_crc32c.h"

#define LONGEST_GROUP 254u

#define PIECE (2u * 256u)

/* Bytes not yet written: whole groups, then the one in work, its code byte in front. */
typedef struct stuffing {
    uint8_t bytes[PIECE];
    size_t start; /* of the group in work: its code byte */
    size_t end;
    uint32_t crc;
    hil_write write;
    void *context;
} stuffing;

static void end_group(stuffing *s) {
    s->bytes[s->start] = (uint8_t)(s->end - s->start);
    if (s->end > PIECE - LONGEST_GROUP - 2u) { /* no room for another group and the closing delimiter */
        s->write(s->context, s->bytes, s->end);
        s->end = 0;
    }
    s->start = s->end++;
}

static void stuff(stuffing *s, uint8_t byte) {
    if (s->end - s->start > LONGEST_GROUP)
        end_group(s); /* only now: a full group at the very end has no successor */
    if (byte == 0u)
        end_group(s);
    else
        s->bytes[s->end++] = byte;
}

static void stuff_counted(stuffing *s, uint8_t byte) {
    s->crc = hil_crc32c_byte(s->crc, byte);
    stuff(s, byte);
}

void hil_frame_write(const hil_frame *frame, hil_write write, void *context) {
    stuffing s;
    s.bytes[0] = 0u;
    s.start = 1;
    s.end = 2;
    s.crc = HIL_CRC32C_START;
    s.write = write;
    s.context = context;
    stuff_counted(&s, frame->type);
    for (unsigned k = 0; k < 2u; k++)
        stuff_counted(&s, (uint8_t)(frame->seq >> (8u * k)));
    for (unsigned k = 0; k < 4u; k++)
        stuff_counted(&s, (uint8_t)(frame->tick >> (8u * k)));
    for (size_t k = 0; k < frame->size; k++)
        stuff_counted(&s, frame->payload[k]);
    for (unsigned k = 0; k < HIL_CRC_SIZE; k++)
        stuff(&s, (uint8_t)(~s.crc >> (8u * k)));
    s.bytes[s.start] = (uint8_t)(s.end - s.start);
    s.bytes[s.end++] = 0u;
    write(context, s.bytes, s.end);
}

void hil_count(uint32_t *counter, uint32_t more) {
    *counter = more < UINT32_MAX - *counter ? *counter + more : UINT32_MAX;
}

static void begin_run(hil_reader *r) {
    r->body_size = 0;
    r->run_size = 0;
    r->crc = HIL_CRC32C_START;
    r->code = 0;
    r->left = 0;
}

void hil_reader_init(hil_reader *reader, uint8_t *body, size_t room) {
    reader->frames = 0;
    reader->cobs_errors = 0;
    reader->too_short = 0;
    reader->crc_errors = 0;
    reader->oversize = 0;
    reader->body = body;
    reader->room = room;
    begin_run(reader);
}

static void unstuffed(hil_reader *r, uint8_t byte) {
    if (r->body_size < r->room)
        r->body[r->body_size] = byte;
    r->body_size++;
    r->crc = hil_crc32c_byte(r->crc, byte);
}

static void take_inside(hil_reader *r, uint8_t byte) {
    if (r->run_size > HIL_MAX_ENCODED)
        return; /* counted already; everything up to the next delimiter is dropped */
    r->run_size++;
    if (r->run_size > HIL_MAX_ENCODED) {
        hil_count(&r->oversize, 1u);
    } else if (r->left > 0u) {
        r->left--;
        unstuffed(r, byte);
    } else {
        if (r->code != 0u && r->code != 0xFFu)
            unstuffed(r, 0u);
        r->code = byte;
        r->left = (uint8_t)(byte - 1u);
    }
}

/* The run is complete: which counter does it belong to? */
static uint32_t *judge(hil_reader *r) {
    if (r->left > 0u)
        return &r->cobs_errors;
    if (r->body_size < HIL_MIN_BODY)
        return &r->too_short;
    if (r->crc != HIL_CRC32C_RESIDUE)
        return &r->crc_errors;
    if (r->body_size > HIL_MAX_BODY)
        return &r->oversize;
    return &r->frames;
}

bool hil_reader_take(hil_reader *reader, uint8_t byte, hil_frame *frame) {
    bool intact = false;
    if (byte != 0u) {
        take_inside(reader, byte);
        return false;
    }
    if (reader->run_size > 0u && reader->run_size <= HIL_MAX_ENCODED) {
        uint32_t *counter = judge(reader);
        hil_count(counter, 1u);
        intact = counter == &reader->frames;
    }
    if (intact) {
        const uint8_t *body = reader->body;
        frame->type = body[0];
        frame->sequenced = true;
        frame->seq = (uint16_t)(body[1] | body[2] << 8);
        frame->tick = body[3] | (uint32_t)body[4] << 8 | (uint32_t)body[5] << 16 | (uint32_t)body[6] << 24;
        frame->payload = body + HIL_HEADER_SIZE;
        frame->size = reader->body_size - HIL_MIN_BODY;
    }
    begin_run(reader);
    return intact;
}

uint32_t hil_reader_bad(const hil_reader *reader) {
    uint32_t bad = reader->cobs_errors;
    hil_count(&bad, reader->too_short);
    hil_count(&bad, reader->crc_errors);
    hil_count(&bad, reader->oversize);
    return bad;
}
