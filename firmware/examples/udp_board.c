/* A board on UDP that hears only who holds its key: the library around a resonator, on wall time or in lockstep.
 *
 *     udp_board GROUP:PORT KEYFILE [INTERFACE [--estimator]]
 *
 * Prints one line, `ready udp:GROUP:PORT?interface=INTERFACE&key=KEYFILE`, then serves until it is killed. INTERFACE is
 * the address of a network interface, 127.0.0.1 unless given. --estimator: as of pty_board. KEYFILE is what `hil key` makes; firmware without a file
 * system has the 32 bytes in its flash.
 */
#define _DEFAULT_SOURCE /* struct ip_mreq, getrandom */

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "estimating.h"
#include "hil_board.h"
#include "hil_keyed.h"
#include "resonator.h"

#define NS_PER_S 1000000000
#define ROWS 100u
#define WIDTH 2u
#define IDLE_MS 100

typedef struct station {
    hil_board board;
    hil_keyed keyed;
    resonator mass;
    estimating own;
    int wire;
    bool running; /* on wall time, ticks have begun */
    int64_t origin_ns;
} station;

static int64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * NS_PER_S + now.tv_nsec;
}

static uint64_t board_time_ns(void *context) {
    (void)context;
    return (uint64_t)now_ns();
}

static void fresh_nonce(void *context, uint8_t nonce[HIL_NONCE_SIZE]) {
    (void)context;
    if (getrandom(nonce, HIL_NONCE_SIZE, 0) != (ssize_t)HIL_NONCE_SIZE)
        abort(); /* without it there is no session that could be told from an old one */
}

/* An address and a port as one number, and back. */
static bool transmit(void *context, uint64_t to, const uint8_t *datagram, size_t size) {
    const station *s = context;
    struct sockaddr_in address;
    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = (in_addr_t)(to >> 16);
    address.sin_port = (in_port_t)(to & 0xFFFFu);
    return sendto(s->wire, datagram, size, 0, (struct sockaddr *)&address, sizeof address) == (ssize_t)size;
}

static void listen_to(station *s) {
    uint8_t datagram[HIL_MAX_ENCODED + 256u]; /* what is cut short bears no tag */
    struct sockaddr_in from;
    socklen_t length = sizeof from;
    ssize_t size;
    while ((size = recvfrom(s->wire, datagram, sizeof datagram, 0, (struct sockaddr *)&from, &length)) >= 0) {
        uint64_t sender = (uint64_t)from.sin_addr.s_addr << 16 | from.sin_port;
        hil_keyed_receive(&s->keyed, &s->board, sender, datagram, (size_t)size);
        length = sizeof from;
    }
}

/* One tick: what a board of silicon does in its sample interrupt. */
static void tick(station *s) {
    int32_t vx, vy;
    hil_drive drive = hil_board_drive(&s->board);
    if (s->board.tick >= 0) /* row 0 is the start: nothing came before it */
        resonator_step(&s->mass, drive.ux, drive.uy);
    int clipped = resonator_sense(&s->mass, &vx, &vy);
    hil_board_sample(&s->board, vx, vy, clipped != 0);
    hil_board_poll(&s->board);
}

static void serve(station *s) {
    double tick_ns = NS_PER_S / s->mass.device->sample_rate_Hz;
    for (;;) {
        struct pollfd line = {s->wire, POLLIN, 0};
        int64_t wait_ms = IDLE_MS;
        if (hil_board_lockstep(&s->board) || !s->board.started) {
            s->running = false;
        } else {
            if (!s->running)
                s->origin_ns = now_ns() - (int64_t)((double)(s->board.tick + 1) * tick_ns);
            s->running = true;
            wait_ms = (s->origin_ns + (int64_t)((double)(s->board.tick + 1) * tick_ns) - now_ns()) / 1000000;
        }
        if (poll(&line, 1, wait_ms > 0 ? (int)wait_ms : 0) < 0 && errno != EINTR)
            return;
        listen_to(s);
        while (hil_board_may_go_on(&s->board))
            tick(s);
        while (s->running && !hil_board_lockstep(&s->board) &&
               s->origin_ns + (int64_t)((double)(s->board.tick + 1) * tick_ns) <= now_ns())
            tick(s);
        hil_board_poll(&s->board);
    }
}

/* `gyrohil-key-1`, 64 hexadecimal digits, a line end; a file that nobody else may read. */
static bool read_key(const char *path, uint8_t key[HIL_KEY_SIZE]) {
    char digits[2u * HIL_KEY_SIZE + 1u];
    struct stat about;
    FILE *file = fopen(path, "r");
    if (file == NULL)
        return false;
    bool good = !fstat(fileno(file), &about) && !(about.st_mode & 077) &&
                fscanf(file, "gyrohil-key-1 %64[0-9a-fA-F]", digits) == 1 && strlen(digits) == 2u * HIL_KEY_SIZE;
    (void)fclose(file);
    for (unsigned k = 0; good && k < HIL_KEY_SIZE; k++) {
        char pair[3] = {digits[2u * k], digits[2u * k + 1u], '\0'};
        key[k] = (uint8_t)strtoul(pair, NULL, 16);
    }
    if (!good)
        errno = EACCES;
    return good;
}

static bool join(station *s, const char *group, unsigned port, const char *interface) {
    struct sockaddr_in address;
    struct ip_mreq membership;
    int off = 0;
    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_port = htons((uint16_t)port);
    if (!inet_aton(group, &address.sin_addr) || !inet_aton(interface, &membership.imr_interface)) {
        errno = EINVAL;
        return false;
    }
    membership.imr_multiaddr = address.sin_addr;
    s->wire = socket(AF_INET, SOCK_DGRAM, 0);
    return s->wire >= 0 && !bind(s->wire, (struct sockaddr *)&address, sizeof address) &&
           !setsockopt(s->wire, IPPROTO_IP, IP_MULTICAST_ALL, &off, sizeof off) &&
           !setsockopt(s->wire, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) &&
           !fcntl(s->wire, F_SETFL, O_NONBLOCK);
}

static bool set_up(station *s, const char *key_file, bool estimator) {
    static uint8_t blocks[HIL_BLOCKS_SIZE(ROWS, WIDTH)];
    static resonator_device device;
    static uint8_t datagram[HIL_KEYED_ROOM(HIL_SENSE_SIZE + ROWS * HIL_SENSE_COLUMNS * WIDTH)];
    hil_config config;
    hil_keyed_config keyed;
    memset(&config, 0, sizeof config);
    memset(&keyed, 0, sizeof keyed);
    if (!read_key(key_file, keyed.key))
        return false;
    keyed.datagram = datagram;
    keyed.room = sizeof datagram;
    keyed.nonce = fresh_nonce;
    keyed.send = transmit;
    keyed.context = s;
    device = resonator_slow;
    device.rate_rad_s = 1.0;
    config.identity = resonator_identity(&device, 0xC99, 1);
    config.clocks = 1u << HIL_CLOCK_MODE_LOCKSTEP | 1u << HIL_CLOCK_MODE_PACED;
    config.link = &s->keyed.link;
    config.blocks = blocks;
    config.blocks_size = sizeof blocks;
    config.now_ns = board_time_ns;
    resonator_init(&s->mass, &device, 1);
    if (estimator && estimating_init(&s->own, &config.identity) == NULL)
        config.estimator = &s->own.face;
    errno = EINVAL;
    return hil_keyed_init(&s->keyed, &keyed) && hil_board_init(&s->board, &config);
}

int main(int argc, char **argv) {
    static station s;
    char *colon = argc > 2 ? strchr(argv[1], ':') : NULL;
    const char *interface = argc > 3 ? argv[3] : "127.0.0.1";
    if (colon == NULL) {
        fprintf(stderr, "udp_board: expected GROUP:PORT KEYFILE [INTERFACE [--estimator]]\n");
        return 2;
    }
    *colon = '\0';
    unsigned port = (unsigned)strtoul(colon + 1, NULL, 10);
    if (!set_up(&s, argv[2], argc > 4 && !strcmp(argv[4], "--estimator")) || !join(&s, argv[1], port, interface)) {
        fprintf(stderr, "udp_board: cannot start: %s\n", strerror(errno));
        return 2;
    }
    printf("ready udp:%s:%u?interface=%s&key=%s\n", argv[1], port, interface, argv[2]);
    fflush(stdout);
    serve(&s);
    return 0;
}
