/* Attacks on a keyed board: forged, replayed, reordered, damaged, reflected, of other sessions and without a key.
 *
 *     attack [ATTACKS [SEED]]
 *
 * A host that holds the key talks in between, so that there is always a session to attack and something fresh to
 * record; sessions end, other ones begin, the board is switched off and on. Prints one line of JSON: attacks by kind,
 * how many of them the board took, and how many of the host's frames it did not take. Exit code 1 unless both are 0.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hil_board.h"
#include "hil_keyed.h"

#define LONGEST 256u
#define RECORDED 512u /* datagrams of the host, of this session and earlier ones */
#define HOST 1u
#define OTHER 2u

typedef struct datagram {
    uint8_t data[LONGEST];
    size_t size;
} datagram;

typedef enum kind {
    REPLAYED,    /* as recorded, delivered before, in this session */
    EARLIER,     /* recorded in a session before, on whatever board there was */
    REORDERED,   /* held back until a newer one was delivered */
    FLIPPED,     /* one to four bits of a recorded or of an undelivered one */
    CUT,         /* an undelivered one, cut short, or with something behind it */
    COUNTED_UP,  /* a recorded one with a newer counter */
    INVENTED,    /* a plausible frame, with any tag */
    NOISE,       /* any bytes */
    UNKEYED,     /* a frame without counter and tag, which a board on a serial line would take */
    REFLECTED,   /* what the board said */
    RESPLICED,   /* the counter of one, the frame of another, the tag of a third */
    ELSEWHERE,   /* an undelivered one, from another address */
    KINDS
} kind;

static const char *const names[KINDS] = {"replayed", "earlier session", "reordered", "bits flipped",
                                         "cut",      "counted up",      "invented",  "noise",
                                         "unkeyed",  "reflected",       "respliced", "from elsewhere"};

/* The host. */
static uint8_t secret[HIL_KEY_SIZE];
static hil_blake2s deriving, calling, sealing;
static uint8_t nonces[2u * HIL_NONCE_SIZE];
static uint64_t counter;
static uint16_t seq;

/* The board. */
static hil_board board;
static hil_keyed link;
static uint8_t blocks[HIL_BLOCKS_SIZE(4, 2)];
static uint8_t memory[HIL_KEYED_ROOM(256)];
static datagram said; /* by the board, last */
static uint64_t told; /* datagrams of the board */

/* The attacker. */
static datagram recorded[RECORDED];
static uint64_t recordings, this_session; /* first recording of the session */
static datagram late;                     /* of this session, kept back while newer ones were delivered */
static bool overtaken;
static uint64_t tried[KINDS], taken[KINDS], spoken, unheard, sessions, restarts;

static uint64_t state;

static uint32_t chance(uint32_t below) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return below ? (uint32_t)(state >> 32) % below : 0u;
}

static void any(uint8_t *at, size_t size) {
    for (size_t k = 0; k < size; k++)
        at[k] = (uint8_t)chance(256);
}

/* ----------------------------------------------------------------------------------------------------- the board */

static uint64_t now_ns(void *context) {
    (void)context;
    static uint64_t now;
    return now += 1000u; /* a second never passes unheard: the host keeps the board */
}

static void fresh(void *context, uint8_t *nonce) {
    (void)context;
    static uint64_t count;
    memset(nonce, 0, HIL_NONCE_SIZE);
    count++;
    memcpy(nonce, &count, sizeof count); /* a count is enough: it need not be secret */
}

static bool transmit(void *context, uint64_t to, const uint8_t *data, size_t size) {
    (void)context;
    (void)to;
    told++;
    if (size <= LONGEST) {
        memcpy(said.data, data, size);
        said.size = size;
    }
    return true;
}

static void power_up(void) {
    hil_config config;
    hil_keyed_config keyed;
    memset(&config, 0, sizeof config);
    memset(&keyed, 0, sizeof keyed);
    memcpy(keyed.key, secret, sizeof secret);
    keyed.datagram = memory;
    keyed.room = sizeof memory;
    keyed.nonce = fresh;
    keyed.send = transmit;
    config.identity.tick_rate_Hz = 4000.0;
    config.identity.sense_bits = config.identity.drive_bits = 16;
    config.clocks = 7u;
    config.link = &link.link;
    config.blocks = blocks;
    config.blocks_size = sizeof blocks;
    config.now_ns = now_ns;
    if (!hil_keyed_init(&link, &keyed) || !hil_board_init(&board, &config))
        abort();
    restarts++;
}

/* Whatever the board would do on account of a frame shows in one of these. */
static uint64_t effects(void) {
    return (uint64_t)link.reader.frames + hil_reader_bad(&link.reader) + link.open + link.least;
}

/* ------------------------------------------------------------------------------------------------------ the host */

static void add(void *context, const uint8_t *data, size_t size) {
    datagram *d = context;
    if (d->size + size > LONGEST)
        abort();
    memcpy(d->data + d->size, data, size);
    d->size += size;
}

static void frame_of(datagram *d, uint8_t type) {
    uint8_t payload[HIL_MAX_HOST_PAYLOAD];
    hil_hello hello = {HIL_PROTOCOL, HIL_SPEC_HASH};
    hil_safe safe = {HIL_SAFE_REASON_HOST_REQUEST};
    hil_drive_force force = {32767, 32767, (uint32_t)(board.tick + 2)};
    hil_time_sync sync = {state, 0};
    hil_register_write write = {hil_registers[HIL_REGISTER_DRIVE_LIMIT].id, (double)chance(1000)};
    hil_frame frame = {type, true, seq, 0, payload, 0};
    switch (type) {
    case HIL_TYPE_HELLO:
        frame.size = hil_pack_hello(&hello, payload);
        break;
    case HIL_TYPE_SAFE:
        frame.size = hil_pack_safe(&safe, payload);
        break;
    case HIL_TYPE_DRIVE_FORCE:
        frame.size = hil_pack_drive_force(&force, payload);
        break;
    case HIL_TYPE_REGISTER_WRITE:
        frame.size = hil_pack_register_write(&write, payload);
        break;
    case HIL_TYPE_TIME_SYNC:
        frame.size = hil_pack_time_sync(&sync, payload);
        break;
    default:
        break;
    }
    hil_frame_write(&frame, add, d);
}

static uint8_t some_type(void) {
    static const uint8_t types[] = {HIL_TYPE_SAFE,        HIL_TYPE_ARM,       HIL_TYPE_DRIVE_FORCE,
                                    HIL_TYPE_DRIVE_FORCE, HIL_TYPE_TIME_SYNC, HIL_TYPE_REGISTER_WRITE};
    return types[chance(sizeof types)];
}

static void seal(datagram *d) {
    hil_blake2s_of(&sealing, d->data, d->size, d->data + d->size);
    d->size += HIL_TAG_SIZE;
}

/* The next datagram of the host. */
static void compose(datagram *d) {
    d->data[0] = HIL_KEYED_FRAME;
    memcpy(d->data + 1, &counter, sizeof counter);
    d->size = HIL_KEYED_HEAD;
    counter++;
    frame_of(d, some_type());
    seq++;
    seal(d);
}

static void record(const datagram *d) {
    recorded[recordings++ % RECORDED] = *d;
}

/* Deliver what the host said: it must be taken. */
static void deliver(const datagram *d) {
    uint32_t before = link.reader.frames;
    hil_keyed_receive(&link, &board, HOST, d->data, d->size);
    unheard += link.reader.frames != before + 1u;
    spoken++;
    record(d);
}

static void derive(const char *label, const uint8_t *with, hil_blake2s *key) {
    uint8_t text[64], derived[HIL_KEY_SIZE];
    size_t size = strlen(label);
    memcpy(text, label, size);
    if (with != NULL)
        memcpy(text + size, with, sizeof nonces);
    hil_blake2s_of(&deriving, text, size + (with != NULL ? sizeof nonces : 0u), derived);
    hil_blake2s_init(key, derived, sizeof derived, HIL_TAG_SIZE);
}

static void begin_session(void) {
    datagram d;
    d.data[0] = HIL_KEYED_CALL;
    any(nonces, HIL_NONCE_SIZE);
    memcpy(d.data + 1, nonces, HIL_NONCE_SIZE);
    hil_blake2s_of(&calling, d.data, 1u + HIL_NONCE_SIZE, d.data + 1u + HIL_NONCE_SIZE);
    d.size = 1u + HIL_NONCE_SIZE + HIL_TAG_SIZE;
    hil_keyed_receive(&link, &board, HOST, d.data, d.size);
    record(&d);
    if (said.data[0] != HIL_KEYED_CHALLENGE)
        abort();
    memcpy(nonces + HIL_NONCE_SIZE, said.data + 1u + HIL_NONCE_SIZE, HIL_NONCE_SIZE);
    derive("host", nonces, &sealing);
    counter = 0;
    d.data[0] = HIL_KEYED_OPEN;
    memcpy(d.data + 1, nonces, sizeof nonces);
    d.size = 1u + sizeof nonces;
    frame_of(&d, HIL_TYPE_HELLO);
    seq++;
    seal(&d);
    this_session = recordings;
    overtaken = false;
    sessions++;
    deliver(&d);
}

/* -------------------------------------------------------------------------------------------------- the attacker */

/* A recording of this session, or of an earlier one; NULL if there is none. */
static const datagram *recording(bool earlier) {
    uint64_t kept = recordings < RECORDED ? recordings : RECORDED;
    uint64_t here = recordings - this_session < kept ? recordings - this_session : kept;
    uint64_t back = earlier ? here + 1u + chance((uint32_t)(kept - here)) : 1u + chance((uint32_t)here);
    return (earlier ? kept == here : here == 0u) ? NULL : &recorded[(recordings - back) % RECORDED];
}

static void flip(datagram *d) {
    uint32_t bits[4], n = 1u + chance(4);
    for (uint32_t k = 0; k < n; k++) { /* each another one, or they would cancel */
        bool again = true;
        while (again) {
            bits[k] = chance((uint32_t)d->size * 8u);
            again = false;
            for (uint32_t j = 0; j < k; j++)
                again = again || bits[j] == bits[k];
        }
        d->data[bits[k] / 8u] ^= (uint8_t)(1u << bits[k] % 8u);
    }
}

/* One attack; `next` is what the host says next, which the attacker has and the board has not. False if there is
 * nothing yet to attack with. */
static bool attack(const datagram *next) {
    kind what = (kind)chance(KINDS);
    const datagram *old = what == REORDERED && overtaken ? &late : recording(what == EARLIER);
    uint64_t from = chance(4) ? HOST : OTHER; /* an address proves nothing */
    datagram d;
    if (old == NULL || (what == REORDERED && !overtaken))
        return false;
    d = *old;
    switch (what) {
    case REPLAYED:
    case EARLIER:
    case REORDERED:
        break;
    case FLIPPED:
        if (chance(2))
            d = *next;
        flip(&d);
        break;
    case CUT:
        d = *next;
        if (chance(4)) {
            d.size = chance((uint32_t)d.size);
        } else {
            size_t more = 1u + chance(16);
            any(d.data + d.size, more);
            d.size += more;
        }
        break;
    case COUNTED_UP:
        for (unsigned k = 0; k < 8u; k++)
            d.data[1u + k] = (uint8_t)((counter + chance(1000)) >> (8u * k));
        break;
    case INVENTED:
        d.data[0] = (uint8_t)(chance(8) ? HIL_KEYED_FRAME : HIL_KEYED_OPEN);
        memcpy(d.data + 1, &counter, sizeof counter);
        d.size = HIL_KEYED_HEAD;
        if (d.data[0] == HIL_KEYED_OPEN) { /* with the nonce that is asked for, which everybody can hear */
            memcpy(d.data + 1, nonces, HIL_NONCE_SIZE);
            memcpy(d.data + 1 + HIL_NONCE_SIZE, link.nonce, HIL_NONCE_SIZE);
            d.size = 1u + sizeof nonces;
        }
        frame_of(&d, d.data[0] == HIL_KEYED_OPEN ? HIL_TYPE_HELLO : some_type());
        any(d.data + d.size, HIL_TAG_SIZE);
        d.size += HIL_TAG_SIZE;
        break;
    case NOISE:
        d.size = chance(LONGEST);
        any(d.data, d.size);
        if (d.size > 0u && chance(4))
            d.data[0] = (uint8_t)(HIL_KEYED_CALL + chance(4));
        break;
    case UNKEYED:
        d.size = 0;
        frame_of(&d, chance(4) ? some_type() : HIL_TYPE_HELLO);
        break;
    case REFLECTED:
        d = said;
        break;
    case RESPLICED:
        memcpy(d.data + 1, next->data + 1, sizeof counter);
        if (chance(2))
            memcpy(d.data + d.size - HIL_TAG_SIZE, next->data + next->size - HIL_TAG_SIZE, HIL_TAG_SIZE);
        break;
    case ELSEWHERE:
        d = *next;
        from = OTHER;
        break;
    case KINDS:
        abort();
    }
    uint64_t before = effects();
    uint32_t refused = link.refused;
    hil_keyed_receive(&link, &board, from, d.data, d.size);
    /* A recorded CALL is answered, and does nothing else. */
    bool answered = d.size > 0u && d.data[0] == HIL_KEYED_CALL && link.refused == refused;
    tried[what]++;
    taken[what] += effects() != before || (link.refused == refused && !answered);
    return true;
}

int main(int argc, char **argv) {
    uint64_t attacks = argc > 1 ? strtoull(argv[1], NULL, 10) : 1000000u, done = 0, all_taken = 0;
    state = (argc > 2 ? strtoull(argv[2], NULL, 10) : 1u) * 0x9E3779B97F4A7C15u | 1u;
    any(secret, sizeof secret);
    hil_blake2s_init(&deriving, secret, sizeof secret, HIL_KEY_SIZE);
    derive("call", NULL, &calling);
    power_up();
    begin_session();
    while (done < attacks) {
        datagram next;
        if (!chance(400)) {
            if (!chance(4))
                power_up();
            begin_session();
        }
        compose(&next);
        bool kept_back = !chance(8);
        if (kept_back) {
            late = next;
            overtaken = false;
            compose(&next);
        }
        for (unsigned n = chance(30); n > 0 && done < attacks; n--)
            done += attack(&next);
        deliver(&next);
        overtaken = overtaken || kept_back;
    }
    printf("{\"attacks\": {");
    for (unsigned k = 0; k < KINDS; k++) {
        printf("%s\"%s\": %llu", k ? ", " : "", names[k], (unsigned long long)tried[k]);
        all_taken += taken[k];
    }
    printf("}, \"taken\": {");
    for (unsigned k = 0; k < KINDS; k++)
        printf("%s\"%s\": %llu", k ? ", " : "", names[k], (unsigned long long)taken[k]);
    printf("}, \"accepted\": %llu, \"spoken\": %llu, \"unheard\": %llu, \"sessions\": %llu, \"restarts\": %llu, "
           "\"answers\": %llu}\n",
           (unsigned long long)all_taken, (unsigned long long)spoken, (unsigned long long)unheard,
           (unsigned long long)sessions, (unsigned long long)restarts, (unsigned long long)told);
    return all_taken > 0 || unheard > 0;
}
