#include "hil_keyed.h"

#include <string.h>

#define CALL_BODY (1u + HIL_NONCE_SIZE)
#define CHALLENGE_BODY (2u + 2u * HIL_NONCE_SIZE)
#define OPEN_HEAD (1u + 2u * HIL_NONCE_SIZE)

#define LAST_COUNTER UINT64_MAX

/* ------------------------------------------------------------------------------------------------- tags and keys */

/* Whether two tags are the same, in a time that does not tell where they differ. */
static bool same(const uint8_t *a, const uint8_t *b) {
    volatile uint8_t difference = 0;
    for (size_t k = 0; k < HIL_TAG_SIZE; k++)
        difference = (uint8_t)(difference | (a[k] ^ b[k]));
    return difference == 0u;
}

/* Whether a datagram ends with the tag of what stands before it. */
static bool tagged(const hil_blake2s *key, const uint8_t *datagram, size_t size) {
    uint8_t tag[HIL_TAG_SIZE];
    hil_blake2s_of(key, datagram, size - HIL_TAG_SIZE, tag);
    return same(tag, datagram + size - HIL_TAG_SIZE);
}

/* The key for one purpose, ready for tags. `nonces` are two, or NULL. */
static void derive(const hil_keyed *k, const char *label, const uint8_t *nonces, hil_blake2s *key) {
    uint8_t text[16u + 2u * HIL_NONCE_SIZE], derived[HIL_KEY_SIZE];
    size_t size = strlen(label);
    memcpy(text, label, size);
    if (nonces != NULL) {
        memcpy(text + size, nonces, 2u * HIL_NONCE_SIZE);
        size += 2u * HIL_NONCE_SIZE;
    }
    hil_blake2s_of(&k->deriving, text, size, derived);
    hil_blake2s_init(key, derived, sizeof derived, HIL_TAG_SIZE);
}

/* ------------------------------------------------------------------------------------------------------- sending */

static void append(void *context, const uint8_t *data, size_t size) {
    hil_keyed *k = context;
    memcpy(k->config.datagram + k->filled, data, size);
    k->filled += size;
}

static bool send(hil_link *link, const hil_frame *frame) {
    hil_keyed *k = (hil_keyed *)link; /* its first member */
    uint8_t *datagram = k->config.datagram;
    if (!k->open || k->last_sent || k->config.room < HIL_KEYED_ROOM(frame->size))
        return false;
    datagram[0] = HIL_KEYED_FRAME;
    for (unsigned n = 0; n < 8u; n++)
        datagram[1u + n] = (uint8_t)(k->counter >> (8u * n));
    k->last_sent = k->counter == LAST_COUNTER;
    k->counter++;
    k->filled = HIL_KEYED_HEAD;
    hil_frame_write(frame, append, k);
    hil_blake2s_of(&k->outgoing, datagram, k->filled, datagram + k->filled);
    return k->config.send(k->config.context, k->peer, datagram, k->filled + HIL_TAG_SIZE);
}

static uint16_t numbers(const hil_link *link, uint32_t rows, unsigned width) {
    (void)link;
    (void)rows;
    (void)width;
    return 1u;
}

static uint32_t bad(const hil_link *link) {
    return hil_reader_bad(&((const hil_keyed *)link)->reader);
}

bool hil_keyed_init(hil_keyed *keyed, const hil_keyed_config *config) {
    if (config->room < HIL_KEYED_ROOM(HIL_MAX_ANSWER))
        return false;
    memset(keyed, 0, sizeof *keyed);
    keyed->link.send = send;
    keyed->link.numbers = numbers;
    keyed->link.bad = bad;
    keyed->config = *config;
    hil_reader_init(&keyed->reader, keyed->body, sizeof keyed->body);
    hil_blake2s_init(&keyed->deriving, config->key, HIL_KEY_SIZE, HIL_KEY_SIZE);
    derive(keyed, "call", NULL, &keyed->calling);
    derive(keyed, "challenge", NULL, &keyed->challenging);
    config->nonce(config->context, keyed->nonce);
    return true;
}

/* ----------------------------------------------------------------------------------------------------- receiving */

static void read_frames(hil_keyed *k, hil_board *board, const uint8_t *data, size_t size) {
    hil_frame frame;
    for (size_t n = 0; n < size; n++)
        if (hil_reader_take(&k->reader, data[n], &frame))
            hil_board_frame(board, &frame);
}

/* Answer a call, from anywhere. Nothing is remembered of it. */
static bool call(hil_keyed *k, uint64_t from, bool taken, const uint8_t *datagram, size_t size) {
    uint8_t answer[CHALLENGE_BODY + HIL_TAG_SIZE];
    if (size != CALL_BODY + HIL_TAG_SIZE || !tagged(&k->calling, datagram, size))
        return false;
    answer[0] = HIL_KEYED_CHALLENGE;
    memcpy(answer + 1, datagram + 1, HIL_NONCE_SIZE);
    memcpy(answer + 1 + HIL_NONCE_SIZE, k->nonce, HIL_NONCE_SIZE);
    answer[CHALLENGE_BODY - 1u] = taken;
    hil_blake2s_of(&k->challenging, answer, CHALLENGE_BODY, answer + CHALLENGE_BODY);
    (void)k->config.send(k->config.context, from, answer, sizeof answer);
    return true;
}

/* Begin a session. The nonce works once. */
static bool open_session(hil_keyed *k, const uint8_t *datagram, size_t size) {
    hil_blake2s incoming;
    const uint8_t *nonces = datagram + 1;
    if (size <= OPEN_HEAD + HIL_TAG_SIZE || memcmp(nonces + HIL_NONCE_SIZE, k->nonce, HIL_NONCE_SIZE) != 0)
        return false;
    derive(k, "host", nonces, &incoming);
    if (!tagged(&incoming, datagram, size))
        return false;
    k->incoming = incoming;
    derive(k, "board", nonces, &k->outgoing);
    k->config.nonce(k->config.context, k->nonce);
    k->least = 0u;
    k->counter = 0u;
    k->last_taken = k->last_sent = false;
    k->open = true;
    return true;
}

/* Whether a FRAME is the host's, and newer than all before. */
static bool take(hil_keyed *k, const uint8_t *datagram, size_t size) {
    uint64_t counter = 0u;
    if (size < HIL_KEYED_HEAD + HIL_TAG_SIZE || datagram[0] != HIL_KEYED_FRAME)
        return false;
    for (unsigned n = 0; n < 8u; n++)
        counter |= (uint64_t)datagram[1u + n] << (8u * n);
    if (counter < k->least || k->last_taken || !tagged(&k->incoming, datagram, size))
        return false;
    k->last_taken = counter == LAST_COUNTER;
    k->least = counter + 1u;
    return true;
}

void hil_keyed_receive(hil_keyed *keyed, hil_board *board, uint64_t from, const uint8_t *datagram, size_t size) {
    hil_keyed *k = keyed;
    uint64_t now_ns = board->config.now_ns(board->config.context);
    bool from_peer = k->open && from == k->peer;
    bool taken = k->open && !from_peer && now_ns - k->heard_ns < HIL_KEYED_PEER_NS;
    size_t head = 0u;
    if (size > 0u && datagram[0] == HIL_KEYED_CALL) {
        if (!call(k, from, taken, datagram, size))
            hil_count(&k->refused, 1u);
        return;
    }
    if (size > 0u && datagram[0] == HIL_KEYED_OPEN && !taken)
        head = open_session(k, datagram, size) ? OPEN_HEAD : 0u;
    else if (from_peer)
        head = take(k, datagram, size) ? HIL_KEYED_HEAD : 0u;
    if (head == 0u) {
        hil_count(&k->refused, 1u);
        return;
    }
    k->peer = from;
    k->heard_ns = now_ns;
    if (size == head + HIL_TAG_SIZE) /* nothing in it: the host leaves */
        k->open = false;
    else
        read_frames(k, board, datagram + head, size - head - HIL_TAG_SIZE);
}
