/* A board on a pty or a CAN interface: the library around a resonator, on wall time or in lockstep.
 *
 *     pty_board [--link pty | can:vcan0 | can:vcan0?node=2] [--rate RAD_S] [--latency TICKS] [--fast] [--seed N]
 *               [--sample-rate HZ] [--fault START_S:DURATION_S] [--realtime] [--estimator] [--wrong START_S:RATE]
 *               [--trims] [--sense-bits N]
 *
 * Prints one line, `ready serial:/dev/pts/N` or `ready can:vcan0`, then serves until it is killed or, in lockstep
 * on a pty, the host hangs up. --fast: 5 kHz sampled at 100 kS/s, for gain mode, instead of 200 Hz at 4 kS/s.
 * --sample-rate: ticks per second in place of these, for a host that is slow.
 * --estimator: the board has the estimator of gyro_estimator.h, for board mode. --wrong: from that second on its rate reads
 * so, `nan` for instance.
 * --trims: two trim outputs, x and y, 0 to 10 V, which soften an axis each by 0.6 % of 1.6e6 1/s2 at 4 V.
 * --sense-bits: of the converter, 16 by default.
 * --fault: a protection of the board's own trips, so many seconds after the first tick, for so long.
 */
#define _GNU_SOURCE /* ppoll, prctl */

#include <errno.h>
#include <poll.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <time.h>

#include "can_socket.h"
#include "estimating.h"
#include "hil_board.h"
#include "hil_can.h"
#include "hil_serial.h"
#include "pty.h"
#include "resonator.h"

#define NS_PER_S 1000000000
#define WIDTH 2u
#define IDLE_NS (NS_PER_S / 2)
#define COAST_NS (NS_PER_S / 50) /* how often a mass that nobody watches is brought up to date */
#define RETRY_NS (NS_PER_S / 1000) /* how often a CAN interface whose queue is full is asked again */
#define LEAD_NS (NS_PER_S / 200) /* from ARM to the first tick */

typedef struct options {
    const resonator_device *device;
    double rate_rad_s;
    double sample_rate_Hz; /* 0: the device's own */
    const char *interface; /* of CAN, NULL for a pty */
    unsigned node;
    unsigned latency;
    unsigned seed;
    unsigned sense_bits; /* 0: the device's own */
    double fault_s[2]; /* start and length of a fault, on the board's clock */
    bool realtime;
    bool estimator;
    bool trims;
    double wrong[2]; /* from which second on, and what the rate reads then */
} options;

typedef struct station {
    hil_board board;
    bool on_can;
    hil_serial serial;
    pty line;
    hil_can can;
    can_socket bus;
    resonator_device device;
    resonator mass;
    estimating own;
    double softer_per_s2[2]; /* what the trim outputs take off its stiffness */
    double tick_ns;
    double fault_ticks[2];
    bool faulty;
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

#define SOFTENING_PER_S2_PER_V2 600.0
#define TRIM_SCALE_V (10.0 / 4095.0)

static const hil_trim_output trims[2] = {
    {.highest = 4095, .scale_V = TRIM_SCALE_V, .name = "x", .name_size = 1},
    {.highest = 4095, .scale_V = TRIM_SCALE_V, .name = "y", .name_size = 1},
};

/* The electrode follows at once. */
static void put_trim(void *context, unsigned output, int32_t code) {
    station *s = context;
    double volts = code * TRIM_SCALE_V;
    resonator_device *device = &s->device;
    device->stiffness_per_s2[output] += s->softer_per_s2[output];
    s->softer_per_s2[output] = SOFTENING_PER_S2_PER_V2 * volts * volts;
    device->stiffness_per_s2[output] -= s->softer_per_s2[output];
    resonator_retune(&s->mass, device);
}

/* What watches over the board: here by the clock only. */
static void protect(station *s) {
    double now = (double)s->board.tick;
    bool faulty = now >= s->fault_ticks[0] && now < s->fault_ticks[1];
    if (faulty && !s->faulty)
        hil_board_safe(&s->board, HIL_SAFE_REASON_FAULT);
    if (!faulty && s->faulty)
        hil_board_fault_gone(&s->board);
    s->faulty = faulty;
}

/* One tick: what a board of silicon does in its sample interrupt. */
static void tick(station *s) {
    int32_t vx, vy;
    protect(s);
    hil_drive drive = hil_board_drive(&s->board);
    if (s->board.tick >= 0) /* row 0 is the start: nothing came before it */
        resonator_step(&s->mass, drive.ux, drive.uy);
    int clipped = resonator_sense(&s->mass, &vx, &vy);
    hil_board_sample(&s->board, vx, vy, clipped != 0);
    hil_board_poll(&s->board); /* a process that was late catches up several ticks at once: each block in its turn */
}

/* When to wake at the latest, and until then listen. */
static int64_t deadline(station *s) {
    if (hil_board_lockstep(&s->board) || !s->board.started) {
        s->running = false;
        return now_ns() + IDLE_NS;
    }
    if (!s->running) {
        s->running = true;
        s->origin_ns = now_ns() + LEAD_NS - (int64_t)((double)(s->board.tick + 1) * s->tick_ns);
    }
    if (!hil_board_streaming(&s->board))
        return now_ns() + COAST_NS;
    double ticks = (double)(s->board.tick + (int64_t)(s->board.block_rows - s->board.block[s->board.filling].rows));
    return s->origin_ns + (int64_t)(ticks * s->tick_ns);
}

/* All the ticks that are due on wall time. */
static void catch_up(station *s) {
    if (!s->running)
        return;
    int64_t due = (int64_t)((double)(now_ns() - s->origin_ns) / s->tick_ns);
    while (s->board.tick < due)
        tick(s);
}

static void advance(station *s) {
    if (hil_board_lockstep(&s->board))
        while (hil_board_may_go_on(&s->board))
            tick(s);
    else
        catch_up(s);
    hil_board_poll(&s->board);
    if (s->on_can)
        can_flush(&s->bus);
    else
        pty_flush(&s->line);
}

static void listen_on_can(station *s) {
    hil_can_frame frame;
    while (can_read(&s->bus, &frame))
        hil_can_receive(&s->can, &s->board, &frame);
}

/* Take what the host says; false when there is nothing more to live for. */
static bool listen_on_pty(station *s, short events) {
    uint8_t data[4096];
    long got = events & (POLLIN | POLLHUP | POLLERR) ? pty_read(&s->line, data, sizeof data) : 0;
    if (got > 0)
        hil_serial_receive(&s->serial, &s->board, data, (size_t)got);
    if (got >= 0)
        return true;
    if (hil_board_lockstep(&s->board))
        return false;
    if (hil_board_streaming(&s->board))
        hil_board_safe(&s->board, HIL_SAFE_REASON_LINK_LOST);
    pty_await(&s->line);
    return true;
}

static void serve(station *s) {
    for (;;) {
        struct pollfd line = {s->on_can ? s->bus.descriptor : s->line.master, POLLIN, 0};
        int64_t left = deadline(s) - now_ns();
        if (!s->on_can && s->line.queued > 0)
            line.events = POLLIN | POLLOUT;
        if (s->on_can && s->bus.queued > 0 && left > RETRY_NS)
            left = RETRY_NS;
        if (left < 0)
            left = 0;
        struct timespec wait = {(time_t)(left / NS_PER_S), (long)(left % NS_PER_S)};
        if (ppoll(&line, 1, &wait, NULL) < 0 && errno != EINTR)
            return;
        if (!hil_board_streaming(&s->board))
            catch_up(s); /* what happened while nobody watched, before somebody watches again */
        if (s->on_can)
            listen_on_can(s);
        else if (!listen_on_pty(s, line.revents))
            return;
        advance(s);
    }
}

static bool set_up(station *s, const options *o) {
    static uint8_t blocks[HIL_BLOCKS_SIZE(682, WIDTH)];
    hil_config config;
    const resonator_device *device = &s->device;
    s->device = *o->device;
    s->device.rate_rad_s = o->rate_rad_s;
    if (o->sample_rate_Hz > 0.0)
        s->device.sample_rate_Hz = o->sample_rate_Hz;
    if (o->sense_bits > 0u)
        s->device.sense_bits = o->sense_bits;
    s->on_can = o->interface != NULL;
    memset(&config, 0, sizeof config);
    config.identity = resonator_identity(device, 0xC99, (uint16_t)o->latency);
    config.clocks = 1u << HIL_CLOCK_MODE_LOCKSTEP | 1u << HIL_CLOCK_MODE_PACED;
    config.blocks = blocks;
    config.blocks_size = sizeof blocks;
    config.now_ns = board_time_ns;
    s->tick_ns = NS_PER_S / device->sample_rate_Hz;
    for (unsigned k = 0; k < 2u; k++)
        s->fault_ticks[k] = (o->fault_s[0] + (k == 1u ? o->fault_s[1] : 0.0)) * device->sample_rate_Hz;
    s->running = false;
    resonator_init(&s->mass, device, o->seed);
    hil_serial_init(&s->serial, pty_free, pty_write, &s->line);
    hil_can_init(&s->can, (uint8_t)o->node, can_free, can_put, &s->bus);
    if (o->estimator) {
        const char *other = estimating_init(&s->own, &config.identity);
        if (other != NULL) {
            fprintf(stderr, "pty_board: the estimator was written for another %s; generate it for this board\n", other);
            return false;
        }
        if (o->wrong[0] > 0.0)
            s->own.wrong_from = o->wrong[0] * device->sample_rate_Hz;
        s->own.wrong_rate_rad_s = o->wrong[1];
        config.estimator = &s->own.face;
    }
    if (o->trims) {
        config.trims = trims;
        config.trim_count = 2u;
        config.put_trim = put_trim;
        config.context = s;
    }
    config.link = s->on_can ? &s->can.link : &s->serial.link;
    if (!hil_board_init(&s->board, &config))
        errno = EINVAL;
    else if (s->on_can ? can_open(&s->bus, o->interface, hil_can_match(&s->can), hil_can_mask()) : pty_open(&s->line))
        return true;
    fprintf(stderr, "pty_board: cannot start: %s\n", strerror(errno));
    return false;
}

/* `pty`, `can:vcan0` or `can:vcan0?node=2`. */
static bool parse_link(options *o, char *link) {
    if (!strcmp(link, "pty"))
        return true;
    if (strncmp(link, "can:", 4) || link[4] == '\0')
        return false;
    o->interface = link + 4;
    char *query = strchr(link, '?');
    if (query == NULL)
        return true;
    char *end;
    *query++ = '\0';
    if (strncmp(query, "node=", 5))
        return false;
    o->node = (unsigned)strtoul(query + 5, &end, 10);
    return end != query + 5 && *end == '\0' && o->node < HIL_CAN_NODES;
}

/* Two numbers with a colon between them; the end of what was read. */
static char *parse_pair(double pair[2], const char *value) {
    char *end;
    pair[0] = strtod(value, &end);
    if (end == value || *end != ':')
        return NULL;
    value = end + 1;
    pair[1] = strtod(value, &end);
    return end == value ? NULL : end;
}

static bool parse(options *o, int argc, char **argv) {
    for (int k = 1; k < argc; k++) {
        char *end = NULL, *value = k + 1 < argc ? argv[k + 1] : "";
        if (!strcmp(argv[k], "--realtime")) {
            o->realtime = true;
            continue;
        }
        if (!strcmp(argv[k], "--estimator")) {
            o->estimator = true;
            continue;
        }
        if (!strcmp(argv[k], "--trims")) {
            o->trims = true;
            continue;
        }
        if (!strcmp(argv[k], "--fast")) {
            o->device = &resonator_fast;
            continue;
        }
        if (!strcmp(argv[k], "--link") && parse_link(o, value))
            end = value + strlen(value);
        else if (!strcmp(argv[k], "--fault"))
            end = parse_pair(o->fault_s, value);
        else if (!strcmp(argv[k], "--wrong"))
            end = parse_pair(o->wrong, value);
        else if (!strcmp(argv[k], "--rate"))
            o->rate_rad_s = strtod(value, &end);
        else if (!strcmp(argv[k], "--sample-rate"))
            o->sample_rate_Hz = strtod(value, &end);
        else if (!strcmp(argv[k], "--latency"))
            o->latency = (unsigned)strtoul(value, &end, 10);
        else if (!strcmp(argv[k], "--seed"))
            o->seed = (unsigned)strtoul(value, &end, 10);
        else if (!strcmp(argv[k], "--sense-bits"))
            o->sense_bits = (unsigned)strtoul(value, &end, 10);
        if (end == NULL || end == value || *end != '\0')
            return false;
        k++;
    }
    return true;
}

int main(int argc, char **argv) {
    static station s;
    options o = {.device = &resonator_slow, .rate_rad_s = 1.0, .latency = 1, .seed = 1};
    if (!parse(&o, argc, argv)) {
        fprintf(stderr, "pty_board: expected [--link pty|can:IFACE[?node=N]] [--rate RAD_S] [--latency TICKS] "
                        "[--fast] [--seed N] [--sample-rate HZ] [--fault START_S:DURATION_S] [--realtime] "
                        "[--estimator] [--wrong START_S:RATE] [--trims] [--sense-bits N]\n");
        return 2;
    }
    if (!set_up(&s, &o))
        return 2;
    (void)prctl(PR_SET_TIMERSLACK, 1);
    if (o.realtime && sched_setscheduler(0, SCHED_FIFO, &(struct sched_param){.sched_priority = 10}))
        fprintf(stderr, "pty_board: no real-time scheduling: %s\n", strerror(errno));
    if (s.on_can && o.node > 0)
        printf("ready can:%s?node=%u\n", o.interface, o.node);
    else
        printf("ready %s:%s\n", s.on_can ? "can" : "serial", s.on_can ? o.interface : s.line.path);
    fflush(stdout);
    serve(&s);
    return 0;
}
