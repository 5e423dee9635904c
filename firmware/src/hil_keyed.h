/* The link for datagrams between machines, such as UDP: who holds the same key is the host, nobody else is heard.
 *
 * docs/wire.md has the layout, docs/security.md what it is worth. The library keeps session, counters and peer; you
 * write two functions, give it the datagrams that arrive, and one nonce a session that no board with this key has used
 * before: random bytes, or the board's serial number and a count that survives a restart.
 */
#ifndef HIL_KEYED_H
#define HIL_KEYED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "hil_blake2s.h"
#include "hil_board.h"
#include "hil_frame.h"
#include "hil_link.h"
#include "hil_serial.h"

#define HIL_KEY_SIZE 32u
#define HIL_NONCE_SIZE 16u
#define HIL_TAG_SIZE 16u

/* First byte of a datagram. */
#define HIL_KEYED_CALL 0xC1u
#define HIL_KEYED_CHALLENGE 0xC2u
#define HIL_KEYED_OPEN 0xC3u
#define HIL_KEYED_FRAME 0xC4u

/* What stands before the frame in FRAME: kind, counter. */
#define HIL_KEYED_HEAD 9u

/* Memory for a datagram with a payload of so many bytes: the largest SENSE, and HIL_MAX_ANSWER at least. */
#define HIL_KEYED_ROOM(payload) \
    (HIL_KEYED_HEAD + 3u + HIL_MIN_BODY + (payload) + (HIL_MIN_BODY + (payload)) / 254u + HIL_TAG_SIZE)

/* So long a board keeps to a host that is silent, while another one asks for it. */
#define HIL_KEYED_PEER_NS 1000000000u

typedef struct hil_keyed_config {
    uint8_t key[HIL_KEY_SIZE];
    uint8_t *datagram; /* memory for one, of HIL_KEYED_ROOM bytes */
    size_t room;
    /* A nonce that was never used with this key. */
    void (*nonce)(void *context, uint8_t nonce[HIL_NONCE_SIZE]);
    /* Send a datagram; false if there is no room for it. `to` is what hil_keyed_receive was told as `from`. */
    bool (*send)(void *context, uint64_t to, const uint8_t *datagram, size_t size);
    void *context;
} hil_keyed_config;

typedef struct hil_keyed {
    hil_link link;
    hil_reader reader;
    uint8_t body[HIL_SERIAL_ROOM];
    hil_keyed_config config;
    hil_blake2s deriving;    /* keys from the key */
    hil_blake2s calling;     /* tags of CALL */
    hil_blake2s challenging; /* tags of CHALLENGE */
    uint8_t nonce[HIL_NONCE_SIZE]; /* of the next session */
    /* The session. */
    bool open;
    hil_blake2s incoming;
    hil_blake2s outgoing;
    uint64_t least; /* smallest counter that is taken */
    bool last_taken; /* the largest counter has come: nothing can be newer */
    uint64_t counter;
    bool last_sent;
    uint64_t peer;
    uint64_t heard_ns;
    size_t filled; /* of the datagram in work */
    uint32_t refused; /* datagrams dropped: forged, replayed, cut short, of another session, of somebody else */
} hil_keyed;

/* A link without a session. False if the memory does not hold the shortest answer. */
bool hil_keyed_init(hil_keyed *keyed, const hil_keyed_config *config);

/* Give the board a datagram that has arrived. `from` names its sender, such as IP address and port in one number. */
void hil_keyed_receive(hil_keyed *keyed, hil_board *board, uint64_t from, const uint8_t *datagram, size_t size);

#endif
