/* A board on a pty: the library around a resonator, on wall time or in lockstep.
 *
 *     pty_board [--rate RAD_S] [--latency TICKS] [--seed N] [--realtime]
 *
 * Prints one line, `ready serial:/dev/pts/N`, then serves until it is killed or, in lockstep, the host hangs up.
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

#include "hil_board.h"
#include "hil_serial.h"
#include "pty.h"
#include "resonator.h"

#define NS_PER_S 1000000000
#define WIDTH 2u
#define IDLE_NS (NS_PER_S / 2)
#define COAST_NS (NS_PER_S / 50) /* how often a mass that nobody watches is brought up to date */
#define LEAD_NS (NS_PER_S / 200) /* from ARM to the first tick */

typedef struct options {
    resonator_device device;
    unsigned latency;
    unsigned seed;
    bool realtime;
} options;

typedef struct station {
    hil_board board;
    hil_serial serial;
    pty line;
    resonator mass;
    double tick_ns;
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

/* One tick: what a board of silicon does in its sample interrupt. */
static void tick(station *s) {
    int32_t vx, vy;
    hil_drive drive = hil_board_drive(&s->board);
    if (s->board.tick >= 0) /* row 0 is the start: nothing came before it */
        resonator_step(&s->mass, drive.ux, drive.uy);
    int clipped = resonator_sense(&s->mass, &vx, &vy);
    hil_board_sample(&s->board, vx, vy, clipped != 0);
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
    pty_flush(&s->line);
}

/* Take what the host says; false when there is nothing more to live for. */
static bool listen(station *s, short events) {
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
        struct pollfd line = {s->line.master, (short)(s->line.queued > 0 ? POLLIN | POLLOUT : POLLIN), 0};
        int64_t left = deadline(s) - now_ns();
        if (left < 0)
            left = 0;
        struct timespec wait = {(time_t)(left / NS_PER_S), (long)(left % NS_PER_S)};
        if (ppoll(&line, 1, &wait, NULL) < 0 && errno != EINTR)
            return;
        if (!hil_board_streaming(&s->board))
            catch_up(s); /* what happened while nobody watched, before somebody watches again */
        if (!listen(s, line.revents))
            return;
        advance(s);
    }
}

static bool set_up(station *s, const options *o) {
    static uint8_t blocks[HIL_BLOCKS_SIZE(682, WIDTH)];
    hil_config config;
    memset(&config, 0, sizeof config);
    config.identity.unique_id = 0xC99;
    config.identity.firmware = 0x00010000;
    config.identity.tick_rate_Hz = o->device.sample_rate_Hz;
    config.identity.axes = 2;
    config.identity.sense_bits = (uint8_t)o->device.sense_bits;
    config.identity.drive_bits = (uint8_t)o->device.drive_bits;
    config.identity.sense_scale_V = resonator_sense_scale_V(&o->device);
    config.identity.drive_scale_mps2 = resonator_drive_scale_mps2(&o->device);
    config.identity.latency_ticks = (uint16_t)o->latency;
    config.clocks = 1u << HIL_CLOCK_MODE_LOCKSTEP | 1u << HIL_CLOCK_MODE_PACED;
    config.blocks = blocks;
    config.blocks_size = sizeof blocks;
    config.now_ns = board_time_ns;
    s->tick_ns = NS_PER_S / o->device.sample_rate_Hz;
    s->running = false;
    resonator_init(&s->mass, &o->device, o->seed);
    hil_serial_init(&s->serial, pty_free, pty_write, &s->line);
    config.link = &s->serial.link;
    return pty_open(&s->line) && hil_board_init(&s->board, &config);
}

static bool parse(options *o, int argc, char **argv) {
    for (int k = 1; k < argc; k++) {
        char *end = NULL;
        const char *value = k + 1 < argc ? argv[k + 1] : "";
        if (!strcmp(argv[k], "--realtime")) {
            o->realtime = true;
            continue;
        }
        if (!strcmp(argv[k], "--rate"))
            o->device.rate_rad_s = strtod(value, &end);
        else if (!strcmp(argv[k], "--latency"))
            o->latency = (unsigned)strtoul(value, &end, 10);
        else if (!strcmp(argv[k], "--seed"))
            o->seed = (unsigned)strtoul(value, &end, 10);
        if (end == NULL || end == value || *end != '\0')
            return false;
        k++;
    }
    return true;
}

int main(int argc, char **argv) {
    static station s;
    options o = {
        {
            .sample_rate_Hz = 4000.0,
            .stiffness_per_s2 = {1.602e6, 1.561e6, -1.2e4}, /* 1 g on springs of 200 Hz */
            .damping_per_s = {1.5, 1.3, 0.05},
            .rate_rad_s = 1.0,
            .start_m = 1e-4,
            .gain_V_per_m = 1000.0,
            .offset_V = {6e-3, -4e-3},
            .noise_V = 1e-4,
            .sense_bits = 16,
            .sense_full_scale_V = 0.25,
            .drive_bits = 16,
            .drive_full_scale_mps2 = 10.0,
        },
        .latency = 1,
        .seed = 1,
        .realtime = false,
    };
    if (!parse(&o, argc, argv)) {
        fprintf(stderr, "pty_board: expected [--rate RAD_S] [--latency TICKS] [--seed N] [--realtime]\n");
        return 2;
    }
    if (!set_up(&s, &o)) {
        fprintf(stderr, "pty_board: cannot start: %s\n", errno ? strerror(errno) : "bad latency");
        return 2;
    }
    (void)prctl(PR_SET_TIMERSLACK, 1);
    if (o.realtime && sched_setscheduler(0, SCHED_FIFO, &(struct sched_param){.sched_priority = 10}))
        fprintf(stderr, "pty_board: no real-time scheduling: %s\n", strerror(errno));
    printf("ready serial:%s\n", s.line.path);
    fflush(stdout);
    serve(&s);
    return 0;
}
