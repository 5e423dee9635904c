/* A stranger's board: a gyro board that speaks the wire of wire.md (protocol 4), written from its pages alone,
 * and that misbehaves on demand (--misbehave NAME).
 *
 *     cc -std=c11 -O2 -Wall -Wextra -Werror board.c -o board -lm
 *     board [--misbehave NAME] [--at TICK] [--log FILE] [--seed N]        serves a pty
 *
 * On stdout: "ready serial:/dev/pts/N". The log says what the board really saw and did: SAFE received, armed, driven ticks, so that a host is judged by the board and not by itself. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>
#include "field_table.h"

#define LINES ((unsigned)(sizeof FIELD_TABLE / sizeof *FIELD_TABLE))
#define PROTOCOL 4u
#define LATENCY 1
#define MAX_PAYLOAD 8192
#define MAX_FRAME 8236
#define MAX_BLOCK 682
#define MAX_WAIT 64
#define SENSE_SCALE (0.25 / 32768)
#define CONVERTER 32767

enum { T_SAFE = 1, T_ARM = 2, T_FORCE = 0x10, T_GAINS = 0x11, T_BOARD = 0x12, T_SENSE = 0x20, T_TIME = 0x30, T_STATUS = 0x31,
       T_NACK = 0x32, T_BRIEF = 0x33, T_HELLO = 0x40, T_IDENTITY = 0x41, T_RREAD = 0x42, T_RWRITE = 0x43,
       T_RVALUE = 0x44, T_FREAD = 0x45, T_FVALUE = 0x46 };
enum { BOOT, IDLE, ARMED, RUNNING, SAFE };
enum { NONE, HOST_REQUEST, INTERRUPTED, RESIDUAL, WATCHDOG, LINK_LOST, FAULT };
enum { N_TYPE = 1, N_LENGTH, N_STATE, N_REGISTER, N_READONLY, N_RANGE, N_SUPPORT, N_LATCHED };
enum { HELD = 1, CLIPPED = 2, SATURATED = 4 };

/* ------------------------------------------------------------------ misbehaviour, log, clock */

static const char *mis_name = "";
static int64_t mis_at = 3000;      /* tick at which what happens in mid run happens */
static FILE *log_to;
static volatile sig_atomic_t ended;

static int mis(const char *name) { return !strcmp(mis_name, name); }
static int mis_pre(const char *prefix) { return !strncmp(mis_name, prefix, strlen(prefix)); }

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static int64_t start_ns;

static void note(const char *fmt, ...)
{
    if (!log_to)
        return;
    va_list a;
    va_start(a, fmt);
    fprintf(log_to, "%.6f ", (now_ns() - start_ns) * 1e-9);
    vfprintf(log_to, fmt, a);
    fputc('\n', log_to);
    fflush(log_to);
    va_end(a);
}

/* ------------------------------------------------------------------ little-endian, CRC, COBS */

static void put(uint8_t **p, uint64_t v, int n) { for (int i = 0; i < n; i++) *(*p)++ = (uint8_t)(v >> 8 * i); }
static uint64_t get(const uint8_t *p, int n)
{
    uint64_t v = 0;
    for (int i = n; i--;)
        v = v << 8 | p[i];
    return v;
}
static void putd(uint8_t **p, double d) { uint64_t v; memcpy(&v, &d, 8); put(p, v, 8); }
static double getd(const uint8_t *p) { uint64_t v = get(p, 8); double d; memcpy(&d, &v, 8); return d; }
static float getf(const uint8_t *p) { uint32_t v = (uint32_t)get(p, 4); float f; memcpy(&f, &v, 4); return f; }

static uint32_t crc_table[256];
static uint32_t crc32c(const uint8_t *p, size_t n)
{
    uint32_t c = 0xffffffffu;
    while (n--)
        c = c >> 8 ^ crc_table[(c ^ *p++) & 255];
    return ~c;
}
static void crc_init(void)
{
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int k = 0; k < 8; k++)
            c = c >> 1 ^ (c & 1 ? 0x82f63b78u : 0);
        crc_table[i] = c;
    }
}

static size_t cobs_encode(const uint8_t *in, size_t n, uint8_t *out)
{
    size_t o = 1, code = 0;
    uint8_t run = 1;
    for (size_t i = 0; i < n; i++) {
        if (in[i]) {
            out[o++] = in[i];
            run++;
        }
        if (!in[i] || run == 255) {
            out[code] = run;
            code = o++;
            run = 1;
        }
    }
    out[code] = run;
    return o;
}
/* Returns the length, or -1 if it is not COBS. `in` holds no zero byte. */
static long cobs_decode(const uint8_t *in, size_t n, uint8_t *out)
{
    size_t o = 0, i = 0;
    while (i < n) {
        uint8_t run = in[i++];
        if (i + run - 1 > n)
            return -1;
        for (int k = 1; k < run; k++)
            out[o++] = in[i++];
        if (run < 255 && i < n)
            out[o++] = 0;
    }
    return (long)o;
}

/* ------------------------------------------------------------------ the oscillator */

#define RATE 4000.0
#define DRIVE_SCALE (10.0 / 32768)

static void wait_s(double seconds)
{
    struct timespec t = { (time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9) };
    nanosleep(&t, NULL);
}

static double state_[4] = { 1e-4, 0, 0, 0 };   /* x, y, x', y' */
static int flip_drive_x = 1, flip_drive_y = 1;

static void derivative(const double *s, double ux, double uy, double *d)
{
    const double kxx = 1610719.4, kyy = 1547554.0, kxy = 15791.4, dxx = 1.3823, dyy = 1.13097, dxy = 0.0628, omega = 1.2;
    d[0] = s[2];
    d[1] = s[3];
    d[2] = ux + 2 * omega * s[3] - dxx * s[2] - dxy * s[3] - kxx * s[0] - kxy * s[1];
    d[3] = uy - 2 * omega * s[2] - dxy * s[2] - dyy * s[3] - kxy * s[0] - kyy * s[1];
}

static void integrate(double ux, double uy)     /* one sample period, RK4, 16 substeps */
{
    enum { SUB = 16 };
    const double h = 1 / RATE / SUB;
    double *s = state_, k1[4], k2[4], k3[4], k4[4], t[4];
    for (int n = 0; n < SUB; n++) {
        derivative(s, ux, uy, k1);
        for (int i = 0; i < 4; i++) t[i] = s[i] + h / 2 * k1[i];
        derivative(t, ux, uy, k2);
        for (int i = 0; i < 4; i++) t[i] = s[i] + h / 2 * k2[i];
        derivative(t, ux, uy, k3);
        for (int i = 0; i < 4; i++) t[i] = s[i] + h * k3[i];
        derivative(t, ux, uy, k4);
        for (int i = 0; i < 4; i++) s[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    }
}

static uint64_t rng = 0x9e3779b97f4a7c15u;
static double uniform(void)
{
    rng ^= rng << 13; rng ^= rng >> 7; rng ^= rng << 17;
    return ((rng >> 11) + 0.5) * 0x1p-53;
}
static double gauss(void) { return sqrt(-2 * log(uniform())) * cos(6.283185307179586 * uniform()); }

/* ------------------------------------------------------------------ the board */

static const struct { uint16_t id; double lo, hi, def; int live, real; } REG[] = {
    { 0x01, 0, 2, 1, 0, 0 }, { 0x02, 0, 1, 0, 0, 0 }, { 0x03, 1, 682, 1, 0, 0 }, { 0x04, 1, 2000000, 80, 0, 0 },
    { 0x05, 0, 8388607, 8388607, 1, 0 }, { 0x06, 0, 16777215, 0, 1, 0 }, { 0x07, 0, 4294967295.0, 0, 0, 0 },
    { 0x10, -16, 16, 0, 0, 1 }, { 0x11, -16, 16, 0, 0, 1 }, { 0x12, -16, 16, 0, 0, 1 }, { 0x13, -16, 16, 0, 0, 1 },
    { 0x14, -16, 16, 1, 0, 1 }, { 0x15, -16, 16, 0, 0, 1 }, { 0x16, -16, 16, 0, 0, 1 }, { 0x17, -16, 16, 1, 0, 1 },
    { 0x18, 1, 63, 1, 0, 0 }, { 0x20, 0, 8388607, 0, 1, 0 }, { 0x21, 1, 4294967295.0, 1, 0, 0 } };
enum { REGS = sizeof REG / sizeof *REG };
static double reg[REGS];
enum { CLOCK_MODE, LOOP_MODE, BLOCK, WATCHDOG_TICKS, DRIVE_LIMIT, STATUS_EVERY, SESSION, A11, A12, A21, A22, B1, B2, C1,
       C2, DELAY, DITHER_AMPLITUDE, DITHER_SEED };

static int st, reason, fault, latched, hello_ok;
static int64_t tick = -1;                  /* newest tick that was sampled, -1: none yet */
static int64_t tick0_ns;                   /* when tick 0 was, paced */
static uint32_t late, held, bad_frames, lost_seq, saturated, trips, dropped;
static uint32_t spec_hash;

typedef struct { int64_t e; int32_t ux, uy; int sat; } Drive;
static Drive waiting[MAX_WAIT], now_;      /* force mode: those that wait, and the one that is held */
static int waits;
static int64_t first_effective, last_accepted;

typedef struct { int id; float g[8], b[2]; int64_t e; } Matrix;
static Matrix active, pending;
static double fs[2][2];                    /* gain mode: s of x and of y */
static int32_t hist[2][64];                /* V of the last 64 ticks */
static uint32_t lfsr;

static uint8_t rows[MAX_BLOCK * 12];
static int n_rows, block_flags, block_matrix;
static int64_t block_tick;

/* what really happened, for the log */
static long armed_count, driven_ticks, safe_count, rows_sent, driven_after_safe, drives_rx, hellos, fields_read;
static int dead, silent_rows, booted_again;

static int is_streaming(void) { return st == ARMED || st == RUNNING; }
static int lockstep(void) { return reg[CLOCK_MODE] == 0; }
static uint32_t tick32(void) { return tick < 0 ? 0 : (uint32_t)tick; }

/* ---- sending */

static int fd = -1, slave = -1;
static char pty_name[128];
static uint8_t outq[1 << 18];
static size_t out_n;
static uint16_t tx_seq;

static void flush_out(void)
{
    while (out_n) {
        ssize_t n = write(fd, outq, out_n);
        if (n <= 0)
            return;
        memmove(outq, outq + n, out_n - (size_t)n);
        out_n -= (size_t)n;
    }
}

static void raw_bytes(const void *p, size_t n)
{
    if (out_n + n > sizeof outq)
        return;
    memcpy(outq + out_n, p, n);
    out_n += n;
    flush_out();
}

static void serial_frame(int type, uint16_t seq, uint32_t tk, const uint8_t *payload, size_t n, int damage)
{
    static uint8_t raw[MAX_PAYLOAD + 64], out[MAX_PAYLOAD + 256];
    uint8_t *p = raw;
    put(&p, (uint64_t)type, 1);
    put(&p, seq, 2);
    put(&p, tk, 4);
    memcpy(p, payload, n);
    p += n;
    put(&p, crc32c(raw, 7 + n) ^ (damage ? 0x5a5au : 0), 4);
    out[0] = 0;
    size_t o = 1 + cobs_encode(raw, (size_t)(p - raw), out + 1);
    out[o++] = 0;
    raw_bytes(out, o);
}

static void emit(int type, uint32_t tk, const uint8_t *payload, size_t n)
{
    int damage = 0;
    static unsigned count;
    count++;
    if (mis("crc_every_2nd") && armed_count)
        damage = count & 1;
    if (mis("crc_all_rows") && type == T_SENSE && tick >= mis_at)
        damage = 1;
    if (mis("seq_jumps") && armed_count)
        tx_seq += 100;
    if (mis("seq_still") && armed_count)
        tx_seq = 7;
    if (mis("seq_backwards") && tick >= mis_at)
        tx_seq -= 2;
    if (type == T_SENSE && !lockstep() && out_n > 16384) {
        dropped++;                                /* its number is missing */
        tx_seq++;
        return;
    }
    serial_frame(type, tx_seq++, tk, payload, n, damage);
}

static void send_status_as(int state, int why)
{
    uint8_t b[34], *p = b;
    put(&p, (uint64_t)state, 1);
    put(&p, (uint64_t)why, 1);
    put(&p, late, 4);
    put(&p, held, 4);
    put(&p, bad_frames, 4);
    put(&p, lost_seq, 4);
    put(&p, saturated, 4);
    put(&p, trips, 4);
    put(&p, dropped, 4);
    put(&p, tick32(), 4);
    emit(T_STATUS, tick32(), b, 34);
}
static void send_status(void)
{
    if (mis("status_never"))
        return;
    if (mis("status_lies_running") && st == ARMED) {
        send_status_as(RUNNING, NONE);
        return;
    }
    if (mis("status_state_99") && st == RUNNING) {
        send_status_as(99, 77);
        return;
    }
    send_status_as(st, st == SAFE ? reason : NONE);
}

static void nack(int type, uint16_t seq, int why)
{
    uint8_t b[4], *p = b;
    put(&p, (uint64_t)type, 1);
    put(&p, seq, 2);
    put(&p, (uint64_t)why, 1);
    emit(T_NACK, tick32(), b, 4);
}

static void send_rows(void)
{
    static uint8_t b[MAX_PAYLOAD];
    if (!n_rows)
        return;
    if (silent_rows) {
        n_rows = block_flags = 0;
        return;
    }
    uint8_t *p = b;
    unsigned n = (unsigned)n_rows, width = 2;
    uint32_t tk = (uint32_t)block_tick;
    int after = block_tick >= mis_at;
    size_t len = 5 + 8 * (size_t)n_rows;
    if (mis("sense_n0") && after) { n = 0; len = 5; }
    if (mis("sense_n65535") && after) n = 65535;
    if (mis("sense_width7") && after) width = 7;
    if (mis("sense_n_too_many") && after) n += 1;
    if (mis("sense_payload_longer") && after) len += 3;
    if (mis("tick_back") && block_tick == mis_at) tk -= 500;
    if (mis("tick_back_for_good") && after) tk -= 500;
    if (mis("tick_leap") && after) tk += 100000000u;
    if (mis("tick_leap_small") && after) tk += 4000;
    if (mis("tick_half") && after) tk ^= 0x80000000u;
    if (mis("tick_repeated") && after) tk = (uint32_t)mis_at;
    int id = block_matrix;
    if (mis("matrix_unknown") && after) id = id ^ 0x80;
    if (mis("matrix_zero") && after) id = 0;
    if (mis("matrix_in_force_mode")) id = 42;
    put(&p, n, 2);
    put(&p, width, 1);
    put(&p, (uint64_t)(mis("flags_all") ? 255 : block_flags), 1);
    put(&p, (uint64_t)id, 1);
    memset(b + 5 + 8 * n_rows, 0, 8);
    memcpy(p, rows, 8 * (size_t)n_rows);
    rows_sent += n_rows;
    n_rows = block_flags = 0;
    emit(T_SENSE, tk, b, len);
    if (mis("rows_twice"))
        emit(T_SENSE, tk, b, len);
    if (mis("rows_twice_other") && after) {       /* the same tick again with other codes */
        b[5] ^= 0x55;
        emit(T_SENSE, tk, b, len);
    }
}

/* ---- states */

static void stop(int why, int tell)
{
    send_rows();
    st = SAFE;
    reason = why;
    now_ = (Drive){ 0 };
    waits = 0;
    active.id = pending.id = 0;
    note("state SAFE reason %d tick %lld", why, (long long)tick);
    if (tell)
        send_status();
}

static void defaults(void)
{
    for (int i = 0; i < REGS; i++)
        reg[i] = REG[i].def;
}

static void reboot(int keep_session)
{
    double session = reg[SESSION], wd = reg[WATCHDOG_TICKS], clock = reg[CLOCK_MODE];
    note("reboot tick %lld", (long long)tick);
    defaults();
    reg[CLOCK_MODE] = clock;                      /* it starts with a mode it can keep */
    if (keep_session) {
        reg[SESSION] = session;
        reg[WATCHDOG_TICKS] = wd;
    }
    st = BOOT;
    reason = NONE;
    fault = latched = hello_ok = n_rows = waits = 0;
    now_ = (Drive){ 0 };
    active.id = pending.id = 0;
    late = held = bad_frames = lost_seq = saturated = trips = dropped = 0;
    tick = -1;
    tx_seq = 0;
    booted_again = 1;
}

/* ---- a tick */

static int32_t clamp(double v, double lim, int *sat)
{
    if (isnan(v))
        v = 0;
    if (lim > CONVERTER)
        lim = CONVERTER;
    if (v > lim) { *sat = 1; return (int32_t)lim; }
    if (v < -lim) { *sat = 1; return (int32_t)-lim; }
    return (int32_t)v;
}

static int32_t convert(double volts, int *flags)
{
    double c = nearbyint(volts / SENSE_SCALE);
    if (c >= 32767) { *flags |= CLIPPED; return 32767; }
    if (c <= -32768) { *flags |= CLIPPED; return -32768; }
    return (int32_t)c;
}

static double dither(void)
{
    int bit = lfsr & 1;
    lfsr >>= 1;
    if (bit)
        lfsr ^= 0xA3000000u;
    return bit ? reg[DITHER_AMPLITUDE] : -reg[DITHER_AMPLITUDE];
}

/* Gain mode: the drive for the interval that begins at m + LATENCY, from the codes of tick m = tick. */
static void compute_gain(const int32_t *v, int *flags)
{
    int d = (int)reg[DELAY], sat = 0;
    if (pending.id && pending.e <= tick) {
        active = pending;
        pending.id = 0;
    }
    for (int a = 0; a < 2; a++) {
        double old = hist[a][(tick - d) & 63], s0 = fs[a][0], s1 = fs[a][1];
        hist[a][tick & 63] = v[a];
        fs[a][0] = reg[A11] * s0 + reg[A12] * s1 + reg[B1] * v[a] + reg[C1] * old;
        fs[a][1] = reg[A21] * s0 + reg[A22] * s1 + reg[B2] * v[a] + reg[C2] * old;
    }
    double dx = dither(), dy = dither(), ux = 0, uy = 0;
    if (active.id) {
        const float *g = active.g;
        ux = g[0] * fs[0][0] + g[1] * fs[0][1] + g[2] * fs[1][0] + g[3] * fs[1][1] + active.b[0] + dx;
        uy = g[4] * fs[0][0] + g[5] * fs[0][1] + g[6] * fs[1][0] + g[7] * fs[1][1] + active.b[1] + dy;
    }
    Drive n = { tick + LATENCY, clamp(nearbyint(ux), reg[DRIVE_LIMIT], &sat),
                clamp(nearbyint(uy), reg[DRIVE_LIMIT], &sat), 0 };
    block_matrix = active.id;
    if (sat) {
        *flags |= SATURATED;
        saturated++;
    }
    if (waits < MAX_WAIT)
        waiting[waits++] = n;
}

static void append_row(const int32_t *v, int32_t ux, int32_t uy, int flags)
{
    if (!n_rows)
        block_tick = tick;
    uint8_t *p = rows + 8 * n_rows++;
    put(&p, (uint16_t)v[0], 2);
    put(&p, (uint16_t)v[1], 2);
    put(&p, (uint16_t)ux, 2);
    put(&p, (uint16_t)uy, 2);
    block_flags |= flags;
}

static void mid_run(void);

static void do_tick(void)
{
    int flags = 0;
    if (tick >= 0) {                              /* the interval from `tick` to the next one */
        int gain = reg[LOOP_MODE] == 1, got = 0;
        for (int i = 0; i < waits; i++)
            if (waiting[i].e <= tick) {
                if (waiting[i].e == tick) {
                    now_ = waiting[i];
                    got = 1;
                }
                waiting[i--] = waiting[--waits];
            }
        if (st == RUNNING && !gain && !got && tick >= first_effective
            && (tick - first_effective) % (int64_t)reg[BLOCK] == 0) {
            held++;
            flags |= HELD;
        }
        int zero = st != RUNNING && !mis("safe_confirmed_but_drives") && !mis("safe_ignored");
        double ux = zero ? 0 : now_.ux, uy = zero ? 0 : now_.uy;
        if (ux != 0 || uy != 0) {
            driven_ticks++;
            if (st == SAFE)
                driven_after_safe++;
        }
        integrate(flip_drive_x * ux * DRIVE_SCALE, flip_drive_y * uy * DRIVE_SCALE);
        if (now_.sat && reg[LOOP_MODE] == 0)
            flags |= SATURATED;
        tick++;
    } else {
        tick = 0;
        tick0_ns = now_ns();
    }
    if (!is_streaming())
        return;
    static const double gain_ = -885.42;
    double gx = mis("sense_flip_x") ? -gain_ : gain_, gy = mis("sense_flip_y") ? -gain_ : gain_;
    if (mis("sense_flip_x_mid") && tick >= mis_at) gx = -gain_;
    if (mis("sense_10x")) gx = gy = 10 * gain_;
    if (mis("sense_weak")) gx = gy = gain_ / 1000;
    int32_t v[2] = { convert(gx * state_[0] + 8.9e-3 + 89e-6 * gauss(), &flags),
                     convert(gy * state_[1] - 7e-3 + 89e-6 * gauss(), &flags) };
    if (mis("stuck_from_start") || (mis("stuck_codes") && tick >= mis_at)) { v[0] = 1234; v[1] = -321; }
    if (mis("zero_codes_from_start")) v[0] = v[1] = 0;
    if (mis("clipped_codes") && tick >= mis_at) { v[0] = 32767; v[1] = -32768; flags |= CLIPPED; }
    if (mis("clipped_from_start")) { v[0] = 32767; v[1] = -32768; flags |= CLIPPED; }
    if (mis("noise_huge") && tick >= mis_at) v[0] = (int32_t)(gauss() * 8000);
    if (mis("axes_swapped")) { int32_t t = v[0]; v[0] = v[1]; v[1] = t; }
    if (reg[LOOP_MODE] == 1)
        compute_gain(v, &flags);
    else
        block_matrix = 0;
    int32_t ex = now_.ux, ey = now_.uy;
    if (mis("echo_zero")) ex = ey = 0;
    if (mis("echo_lies") && tick >= mis_at) { ex = -ex; ey = ey / 2 + 500; }
    append_row(v, ex, ey, flags);
    if (n_rows >= reg[BLOCK])
        send_rows();
    if (reg[STATUS_EVERY] > 0 && tick % (int64_t)reg[STATUS_EVERY] == 0)
        send_status();
    if (st == RUNNING && tick - last_accepted >= reg[WATCHDOG_TICKS]) {
        trips++;
        stop(WATCHDOG, 1);
    }
    mid_run();
}

static void do_block(void)                        /* lockstep: one block */
{
    int n = (int)reg[BLOCK];
    while (n-- && is_streaming())
        do_tick();
}

/* What happens of itself at a tick of the run. */
static void mid_run(void)
{
    static int done;
    if (tick < mis_at || done || !is_streaming())
        return;
    done = 1;
    if (mis("fault_at_tick")) { fault = 1; stop(FAULT, 1); }
    else if (mis("other_node_safe")) { latched = 1; stop(HOST_REQUEST, 1); }
    else if (mis("other_node_residual")) { latched = 1; stop(RESIDUAL, 1); }
    else if (mis("other_node_interrupted")) { latched = 1; stop(INTERRUPTED, 1); }
    else if (mis("safe_reason_99")) { stop(99, 1); }
    else if (mis("safe_reason_none")) { stop(NONE, 1); }
    else if (mis("watchdog_no_cause")) { trips++; stop(WATCHDOG, 1); }
    else if (mis("link_lost_itself")) stop(LINK_LOST, 1);
    else if (mis("stops_untold")) stop(FAULT, 0);
    else if (mis("says_idle")) { stop(NONE, 0); st = IDLE; send_status(); }
    else if (mis("reboot")) reboot(0);
    else if (mis("reboot_session_kept")) reboot(1);
    else if (mis("reboot_says_watchdog")) { reboot(0); st = SAFE; reason = WATCHDOG; trips = 1; hello_ok = 1; send_status(); }
    else if (mis("reboot_says_watchdog_session_kept")) { reboot(1); st = SAFE; reason = WATCHDOG; trips = 1; hello_ok = 1; send_status(); }
    else if (mis("dead_mid_run")) { dead = 1; note("dead"); }
    else if (mis("mute_rows_mid_run")) { silent_rows = 1; note("rows end"); }
    else if (mis("identity_mid_run")) { uint8_t z[51] = { 3 }; emit(T_IDENTITY, tick32(), z, 51); }
    else if (mis("hang_up")) { note("hang up"); close(fd); fd = -1; if (slave >= 0) close(slave); slave = -1; }
    else if (mis("exits")) { note("exit"); ended = 1; }
    else done = mis_at > 0 && tick > mis_at;
}

/* What happens of itself in time, about each millisecond, whatever the clock mode. */
static int after_safe;
static void in_time(void)
{
    if (dead || fd < 0)
        return;
    static int64_t since_safe;
    if (after_safe && (mis("safe_confirmed_but_drives") || mis("safe_ignored") || mis("safe_streams_zero"))) {
        /* rows go on by themselves, in lockstep too */
        if (!since_safe) since_safe = now_ns();
        if ((double)(now_ns() - since_safe) > 5e9) return;
        static int busy;
        if (busy++ % 2) return;
        int keep = st;
        st = RUNNING;
        last_accepted = tick;
        if (mis("safe_streams_zero")) now_ = (Drive){ 0 };
        else if (!now_.ux) now_.ux = now_.uy = 1500;
        do_tick();
        driven_after_safe += now_.ux != 0;
        st = keep;
    }
    if (mis("stream_before_arm") && hellos && !armed_count && out_n < 4096) {
        int keep = st;
        st = ARMED;
        do_tick();
        st = keep;
    }
    if (((mis("status_only") && armed_count) || (mis("status_flood") && armed_count)) && out_n < 8192)
        for (int i = 0; i < 10; i++)
            send_status();
    if (((mis("garbage_flood") && armed_count) || (mis("garbage_before_hello"))) && out_n < 8192) {
        uint8_t b[512];
        for (size_t i = 0; i < sizeof b; i++)
            b[i] = (uint8_t)(uniform() * 256);
        raw_bytes(b, sizeof b);
    }
    if (mis("garbage_endless_no_zero") && tick >= mis_at && out_n < 8192) {
        uint8_t b[512];
        memset(b, 'A', sizeof b);
        raw_bytes(b, sizeof b);
    }
    if (mis("nack_flood") && armed_count && out_n < 8192)
        for (int i = 0; i < 10; i++)
            nack(T_FORCE, (uint16_t)i, N_RANGE);
}

/* ------------------------------------------------------------------ what the host says */

static void send_identity(void)
{
    uint8_t b[80] = { 0 }, *p = b;
    double rate = RATE, ss = SENSE_SCALE, ds = DRIVE_SCALE;
    unsigned axes = 2, sb = 16, db = 16, lat = LATENCY, caps = 15, proto = PROTOCOL;
    uint32_t hash = spec_hash;
    static const struct { const char *name; double v; } odd[] = {
        { "0", 0 }, { "nan", NAN }, { "neg", -1e-5 }, { "inf", INFINITY }, { "tiny", 1e-300 }, { "huge", 1e300 } };
    for (unsigned i = 0; i < sizeof odd / sizeof *odd; i++) {
        if (mis_pre("id_sense_scale_") && !strcmp(mis_name + 15, odd[i].name)) ss = odd[i].v;
        if (mis_pre("id_drive_scale_") && !strcmp(mis_name + 15, odd[i].name)) ds = odd[i].v;
        if (mis_pre("id_rate_") && !strcmp(mis_name + 8, odd[i].name)) rate = odd[i].v;
    }
    if (mis("id_rate_1e12")) rate = 1e12;
    if (mis("id_rate_4001")) rate = RATE * 1.00025;
    if (mis_pre("id_sense_bits_")) sb = (unsigned)atoi(mis_name + 14);
    if (mis_pre("id_drive_bits_")) db = (unsigned)atoi(mis_name + 14);
    if (mis_pre("id_axes_")) axes = (unsigned)atoi(mis_name + 8);
    if (mis_pre("id_latency_")) lat = (unsigned)atoi(mis_name + 11);
    if (mis_pre("id_caps_")) caps = (unsigned)atoi(mis_name + 8);
    if (mis("id_protocol")) proto = 9;
    if (mis("id_hash") || mis("evil_text") || mis("fields_endless") || mis("fields_silent") || mis("fields_same")
        || mis("fields_no_tabs"))
        hash ^= 0x1234;
    put(&p, proto, 2);
    put(&p, hash, 4);
    put(&p, 0x5354524147ull, 8);
    put(&p, 0x00010203, 4);
    putd(&p, rate);
    put(&p, axes, 1);
    put(&p, sb, 1);
    put(&p, db, 1);
    putd(&p, ss);
    putd(&p, ds);
    put(&p, lat, 2);
    put(&p, caps, 4);
    size_t n = (size_t)(p - b);
    if (mis("id_short")) n = 20;
    if (mis("id_long")) n += 9;
    if (mis("id_empty")) n = 0;
    emit(T_IDENTITY, tick32(), b, n);
}

static void on_hello(const uint8_t *d)
{
    hellos++;
    int match = get(d, 2) == PROTOCOL && (uint32_t)get(d + 2, 4) == spec_hash;
    if (is_streaming())
        stop(LINK_LOST, 0);                       /* HELLO's change of state is told by IDENTITY alone */
    hello_ok = match;
    if (match) {
        latched = 0;
        if (st == BOOT)
            st = IDLE;
    }
    note("hello match %d", match);
    if (mis("identity_never"))
        return;
    if (mis("hello_nacked")) { nack(T_HELLO, 0, N_STATE); return; }
    send_identity();
}

static void on_arm(uint16_t seq)
{
    note("arm received in state %d tick %lld", st, (long long)tick);
    if (mis_pre("arm_nack_") && mis_name[9] >= '1' && mis_name[9] <= '9') {
        armed_count++;
        nack(T_ARM, seq, atoi(mis_name + 9));
        return;
    }
    if (mis("arm_nacked_but_armed"))
        nack(T_ARM, seq, N_STATE);
    else if (!hello_ok) { nack(T_ARM, seq, N_STATE); return; }
    if (st == RUNNING) { nack(T_ARM, seq, N_STATE); return; }
    if (st == SAFE && (latched || fault)) { nack(T_ARM, seq, N_LATCHED); return; }
    if (st == ARMED) {
        if (!mis("arm_unanswered_armed"))         /* every time, not only the first */
            send_status();
        return;
    }
    if (reg[LOOP_MODE] == 1) {
        double det = reg[A11] * reg[A22] - reg[A12] * reg[A21], tr = reg[A11] + reg[A22];
        if (!(fabs(det) <= 0.9801 && 0.99 * fabs(tr) <= 0.9801 + det)) { nack(T_ARM, seq, N_RANGE); return; }
    }
    armed_count++;
    if (mis("arm_ignored"))
        return;
    st = ARMED;
    reason = NONE;
    waits = n_rows = block_flags = 0;
    now_ = (Drive){ 0 };
    memset(fs, 0, sizeof fs);
    memset(hist, 0, sizeof hist);
    active.id = pending.id = 0;
    lfsr = (uint32_t)reg[DITHER_SEED];
    note("armed tick %lld", (long long)tick);
    if (mis("silence_after_arm")) { dead = 1; return; }
    if (mis("status_only") || mis("status_then_no_rows")) silent_rows = 1;
    if (mis("arm_answered_idle")) send_status_as(IDLE, NONE);
    else if (mis("arm_answered_safe")) send_status_as(SAFE, HOST_REQUEST);
    else if (!mis_pre("arm_unanswered_") && !mis("arm_nacked_but_armed")) send_status();
    if (mis("arm_unanswered_no_rows")) silent_rows = 1;
    if (lockstep())
        do_block();
    else if (tick < 0)
        do_tick();
}

static void on_safe(const uint8_t *d, size_t n)
{
    int r = n == 1 ? d[0] : HOST_REQUEST;
    safe_count++;
    note("SAFE received reason %d length %zu state %d tick %lld", n ? d[0] : -1, n, st, (long long)tick);
    if (r != INTERRUPTED && r != RESIDUAL && r != LINK_LOST)
        r = HOST_REQUEST;
    after_safe = 1;
    if (mis("safe_ignored")) return;
    if (mis("safe_nacked")) { nack(T_SAFE, 0, N_STATE); return; }
    if (mis("safe_only_5th") && safe_count < 5) return;
    if (mis("safe_only_9th") && safe_count < 9) return;
    if (mis("safe_answered_armed")) { send_status_as(ARMED, NONE); return; }
    if (mis("safe_answered_running")) { send_status_as(RUNNING, NONE); return; }
    int latches = r != LINK_LOST;
    if (st != SAFE) {
        latched = latches;
        stop(r, 0);
    } else if (fault) {
        if (latches) latched = 1;
    } else if (latches && !latched) {
        latched = 1;
        reason = r;
    }
    if (mis("safe_obeyed_unanswered")) return;
    if (mis("safe_says_watchdog")) { send_status_as(SAFE, WATCHDOG); return; }
    if (mis("safe_says_none")) { send_status_as(SAFE, NONE); return; }
    if (mis("safe_says_fault")) { send_status_as(SAFE, FAULT); return; }
    if (mis("safe_hangs_up")) { close(fd); fd = -1; if (slave >= 0) close(slave); slave = -1; note("hang up"); return; }
    send_status();
}

static int64_t full_tick(uint32_t e) { return tick + (int32_t)(e - (uint32_t)tick); }

static void on_force(const uint8_t *d, uint16_t seq)
{
    drives_rx++;
    if (mis("nack_each_drive")) { nack(T_FORCE, seq, N_RANGE); return; }
    if (mis("nack_drives_mid_run") && tick >= mis_at) { nack(T_FORCE, seq, N_RANGE); return; }
    if (mis("deaf_mid_run") && tick >= mis_at) {  /* goes on with rows, hears no drive */
        if (lockstep()) { held++; do_block(); }
        return;
    }
    if (reg[LOOP_MODE] != 0 || !is_streaming()) { nack(T_FORCE, seq, N_STATE); return; }
    uint32_t e32 = (uint32_t)get(d + 8, 4), ahead = e32 - (uint32_t)tick;
    if (ahead < 1 || ahead > 65535) {
        late++;
        if (lockstep())
            do_block();
        return;
    }
    Drive n = { full_tick(e32), 0, 0, 0 };
    n.ux = clamp((int32_t)get(d, 4), reg[DRIVE_LIMIT], &n.sat);
    n.uy = clamp((int32_t)get(d + 4, 4), reg[DRIVE_LIMIT], &n.sat);
    int i = 0;
    while (i < waits && waiting[i].e != n.e)
        i++;
    if (i == MAX_WAIT) { nack(T_FORCE, seq, N_RANGE); return; }
    saturated += (uint32_t)n.sat;
    waiting[i] = n;
    if (i == waits)
        waits++;
    last_accepted = tick;
    if (st == ARMED) {
        st = RUNNING;
        first_effective = n.e;
        note("running tick %lld", (long long)tick);
        send_status();
    } else if (n.e < first_effective)
        first_effective = n.e;
    if (lockstep())
        do_block();
}

static void on_gains(const uint8_t *d, uint16_t seq)
{
    drives_rx++;
    if (mis("nack_each_drive")) { nack(T_GAINS, seq, N_RANGE); return; }
    if (reg[LOOP_MODE] != 1 || !is_streaming()) { nack(T_GAINS, seq, N_STATE); return; }
    Matrix m;
    m.id = d[0];
    int ok = m.id != 0;
    for (int i = 0; i < 8; i++) m.g[i] = getf(d + 1 + 4 * i);
    for (int i = 0; i < 2; i++) m.b[i] = getf(d + 33 + 4 * i);
    for (int i = 0; i < 8; i++) ok &= isfinite(m.g[i]) && fabsf(m.g[i]) <= 0x1p60f;
    for (int i = 0; i < 2; i++) ok &= isfinite(m.b[i]) && fabsf(m.b[i]) <= 0x1p60f;
    if (!ok) { nack(T_GAINS, seq, N_RANGE); return; }
    uint32_t e32 = (uint32_t)get(d + 41, 4), ahead = e32 - (uint32_t)tick;
    m.e = full_tick(e32);
    if (ahead < 1 || ahead > 65535) {
        late++;
        m.e = tick + 1;
    }
    pending = m;
    last_accepted = tick;
    if (st == ARMED) {
        st = RUNNING;
        note("running tick %lld", (long long)tick);
        send_status();
    }
    if (lockstep())
        do_block();
}

static int reg_index(unsigned id)
{
    for (int i = 0; i < REGS; i++)
        if (REG[i].id == id)
            return i;
    return -1;
}

static void send_register(unsigned id, double v)
{
    uint8_t b[10], *p = b;
    if (mis_pre("reg_differs_")) {               /* reg_differs_0004: it holds what was written, and says another number */
        if (strtoul(mis_name + 12, NULL, 16) == id)
            v = id == 1 ? (v == 0 ? 1 : 0) : id == 2 ? 1 - v : id >= 0x10 && id < 0x18 ? v + 0.001 : v + 1;
    }
    if (mis("reg_nan") && id == 4) v = NAN;
    static int n4;
    if (mis("reg_drifts") && id == 4 && ++n4 > 1) v += 1;       /* the second time and later */
    if (mis("reg_drifts_block") && id == 6 && ++n4 > 1) v += 1;
    if (mis("reg_wrong_number")) id += 1;
    put(&p, id, 2);
    putd(&p, v);
    emit(T_RVALUE, tick32(), b, 10);
}

static void on_write(const uint8_t *d, uint16_t seq)
{
    unsigned id = (unsigned)get(d, 2);
    double v = getd(d + 2);
    int i = reg_index(id);
    note("write %04x %.9g", id, v);
    if (mis("register_silent") && id == 4) return;
    if (mis("register_nacked") && id == 4) { nack(T_RWRITE, seq, N_SUPPORT); return; }
    if (mis("wrong_answer") && id == 4) { send_status(); return; }
    if (i < 0) { nack(T_RWRITE, seq, N_REGISTER); return; }
    if (!isfinite(v) || v < REG[i].lo || v > REG[i].hi || (!REG[i].real && v != floor(v))
        || (i == WATCHDOG_TICKS && v > 2 * RATE)) { nack(T_RWRITE, seq, N_RANGE); return; }
    if (!REG[i].live && st != IDLE && st != SAFE) { nack(T_RWRITE, seq, N_STATE); return; }
    if (i == LOOP_MODE && v == 2) { nack(T_RWRITE, seq, N_SUPPORT); return; } /* it has no estimator */
    if (i == CLOCK_MODE && v == 2) { nack(T_RWRITE, seq, N_SUPPORT); return; }
    if (i == CLOCK_MODE && v == 1 && !lockstep()) tick0_ns += 0;
    else if (i == CLOCK_MODE && v == 1)           /* from lockstep to wall time: ticks go on from now */
        tick0_ns = now_ns() - (int64_t)(tick / RATE * 1e9);
    reg[i] = v;
    if (i == DRIVE_LIMIT) {
        int s = 0;
        now_.ux = clamp(now_.ux, v, &s);
        now_.uy = clamp(now_.uy, v, &s);
        now_.sat |= s;
        for (int k = 0; k < waits; k++) {
            waiting[k].ux = clamp(waiting[k].ux, v, &waiting[k].sat);
            waiting[k].uy = clamp(waiting[k].uy, v, &waiting[k].sat);
        }
    }
    send_register(id, reg[i]);
}

static void on_field(const uint8_t *d, uint16_t seq)
{
    unsigned line = (unsigned)get(d, 2);
    static uint8_t b[MAX_PAYLOAD];
    uint8_t *p = b;
    const char *text = line < LINES ? FIELD_TABLE[line] : NULL;
    char made[64];
    unsigned lines = LINES;
    fields_read++;
    if (mis("fields_silent")) return;
    if (mis("fields_endless")) { lines = 65535; snprintf(made, sizeof made, "endless\tline%u\tu8\t1", line); if (line >= LINES) text = made; }
    if (mis("evil_text") && line == 2)
        text = "\033]0;owned\007\033[2J\033[31mverdict good\033[0m\r\n\tu8\t1\t<script>alert(1)</script>\xff\xfe\xe2\x80\xae";
    if (mis("fields_no_tabs")) text = "";
    if (!text) { nack(T_FREAD, seq, N_RANGE); return; }
    put(&p, line, 2);
    put(&p, lines, 2);
    memcpy(p, text, strlen(text));
    emit(T_FVALUE, tick32(), b, 4 + strlen(text));
}

static void on_time(const uint8_t *d)
{
    uint8_t b[16], *p = b;
    static uint64_t frozen, n;
    uint64_t host = get(d, 8), t = (uint64_t)now_ns();
    if (lockstep())
        t = (uint64_t)((tick < 0 ? 0 : tick) / RATE * 1e9);
    if (!frozen) frozen = t;
    if (mis("clock_still")) t = frozen;
    if (mis("clock_backwards")) t = frozen + 60000000000u - (t - frozen);
    if (mis("clock_absurd")) t = UINT64_MAX - 5 + n++ * 77777777777u;
    if (mis("clock_double")) t = frozen + 2 * (t - frozen);
    if (mis("clock_silent")) return;
    if (mis("clock_echo_wrong")) host ^= 0xffff;
    put(&p, host, 8);
    put(&p, t, 8);
    emit(T_TIME, tick32(), b, 16);
}

/* ---- the sequence, and what is refused */

static int seq_known;
static uint16_t seq_next, rep_last;
static int rep_run;

static int in_sequence(uint16_t seq)
{
    if (!seq_known) {
        seq_known = 1;
        seq_next = (uint16_t)(seq + 1);
        return 1;
    }
    uint16_t behind = (uint16_t)(seq_next - seq);
    if (behind >= 1 && behind <= 256) {
        rep_run = rep_run && seq == (uint16_t)(rep_last + 1) ? rep_run + 1 : 1;
        rep_last = seq;
        if (rep_run < 4)
            return 0;
    } else
        lost_seq += (uint16_t)(seq - seq_next);
    rep_run = 0;
    seq_next = (uint16_t)(seq + 1);
    return 1;
}

static void on_message(int type, uint16_t seq, const uint8_t *d, size_t n)
{
    if (type == T_SAFE) {
        if (dead) { safe_count++; note("SAFE received (dead) reason %d", n ? d[0] : -1); return; }
        on_safe(d, n);
        return;
    }
    if (dead) {
        note("unheard %02x", type);
        return;
    }
    if (mis("slow_answers") && type != T_HELLO)   /* beyond any timeout of 2 s */
        wait_s(3);
    if (mis("slow_hello") && type == T_HELLO)
        wait_s(5);
    if (type == T_HELLO && n == 6) {
        seq_known = 1;
        seq_next = (uint16_t)(seq + 1);
        rep_run = 0;
    } else if (!in_sequence(seq))
        return;
    static const struct { int type, len; } lens[] = { { T_ARM, 0 }, { T_FORCE, 12 }, { T_GAINS, 45 }, { T_BOARD, 1 }, { T_TIME, 16 },
        { T_HELLO, 6 }, { T_RREAD, 2 }, { T_RWRITE, 10 }, { T_FREAD, 2 } };
    switch (type) {
    case T_SENSE: case T_STATUS: case T_NACK: case T_BRIEF: case T_IDENTITY: case T_RVALUE: case T_FVALUE:
        nack(type, seq, N_SUPPORT);
        return;
    }
    int len = -1;
    for (unsigned i = 0; i < sizeof lens / sizeof *lens; i++)
        if (lens[i].type == type)
            len = lens[i].len;
    if (type >= 0x50 && type <= 0x6f) { bad_frames++; return; } /* optional: passed over */
    if (len < 0) { bad_frames++; nack(type, seq, N_TYPE); return; }
    if ((size_t)len != n) { bad_frames++; nack(type, seq, N_LENGTH); return; }
    switch (type) {
    case T_HELLO: on_hello(d); break;
    case T_ARM: on_arm(seq); break;
    case T_FORCE: on_force(d, seq); break;
    case T_GAINS: on_gains(d, seq); break;
    case T_BOARD: nack(T_BOARD, seq, N_STATE); break;
    case T_TIME: on_time(d); break;
    case T_RWRITE: on_write(d, seq); break;
    case T_FREAD: on_field(d, seq); break;
    case T_RREAD: {
        unsigned id = (unsigned)get(d, 2);
        int i = reg_index(id);
        note("read %04x", id);
        if (mis("mute_rows_mute_registers")) break;
        if (i < 0) nack(T_RREAD, seq, N_REGISTER);
        else send_register(id, mis("session_other") && i == SESSION ? 4711 : reg[i]);
        break;
    }
    }
}

/* ------------------------------------------------------------------ receiving */

static void serial_byte(uint8_t c)
{
    static uint8_t buf[MAX_FRAME + 1], raw[MAX_FRAME + 1];
    static size_t n;
    static int over;
    if (c) {
        if (n < MAX_FRAME)
            buf[n++] = c;
        else
            over = 1;
        return;
    }
    size_t len = n;
    int bad = over;
    n = 0;
    over = 0;
    if (!len)
        return;
    long k = bad ? -1 : cobs_decode(buf, len, raw);
    if (k < 11 || (uint32_t)get(raw + k - 4, 4) != crc32c(raw, (size_t)k - 4)) {
        bad_frames++;
        return;
    }
    on_message(raw[0], (uint16_t)get(raw + 1, 2), raw + 7, (size_t)k - 11);
}

/* ------------------------------------------------------------------ the port */

static void set_raw(int f)
{
    struct termios t;
    if (!tcgetattr(f, &t)) {
        cfmakeraw(&t);
        tcsetattr(f, TCSANOW, &t);
    }
}

static int open_pty(void)
{
    fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 || grantpt(fd) || unlockpt(fd) || ptsname_r(fd, pty_name, sizeof pty_name))
        return -1;
    slave = open(pty_name, O_RDWR | O_NOCTTY | O_CLOEXEC);   /* held until the host has spoken, then it can be seen to hang up */
    set_raw(slave);
    printf("ready serial:%s\n", pty_name);
    fflush(stdout);
    return 0;
}

static void hung_up(void)
{
    note("host hung up in state %d", st);
    if (is_streaming())
        stop(LINK_LOST, 0);
    out_n = 0;
    slave = open(pty_name, O_RDWR | O_NOCTTY | O_CLOEXEC);
    set_raw(slave);
}

static void receive(void)
{
    if (fd < 0)
        return;
    uint8_t b[4096];
    ssize_t n = read(fd, b, sizeof b);
    if (n > 0) {
        if (slave >= 0) {
            close(slave);
            slave = -1;
        }
        for (ssize_t i = 0; i < n && fd >= 0; i++)
            serial_byte(b[i]);
    } else if (n < 0 && errno == EIO && slave < 0)
        hung_up();
}

static void on_signal(int s) { (void)s; ended = 1; }

int main(int argc, char **argv)
{
    start_ns = now_ns();
    for (int i = 1; i < argc; i++) {
        const char *v = i + 1 < argc ? argv[i + 1] : NULL;
        if (!v) { fprintf(stderr, "strange_board: %s needs a value\n", argv[i]); return 2; }
        if (!strcmp(argv[i], "--misbehave")) mis_name = v;
        else if (!strcmp(argv[i], "--at")) mis_at = atoll(v);
        else if (!strcmp(argv[i], "--seed")) rng ^= strtoull(v, NULL, 0) * 0x2545F4914F6CDD1Du;
        else if (!strcmp(argv[i], "--log")) log_to = fopen(v, "w");
        else { fprintf(stderr, "strange_board: no option %s\n", argv[i]); return 2; }
        i++;
    }
    if (mis("drive_flip_x")) flip_drive_x = -1;
    if (mis("drive_flip_y")) flip_drive_y = -1;
    if (mis("drive_dead")) flip_drive_x = flip_drive_y = 0;
    crc_init();
    {   /* the spec hash is the CRC-32C of the field table */
        static uint8_t all[16384];
        size_t n = 0;
        for (unsigned i = 0; i < LINES; i++) {
            if (i) all[n++] = '\n';
            size_t k = strlen(FIELD_TABLE[i]);
            memcpy(all + n, FIELD_TABLE[i], k);
            n += k;
        }
        spec_hash = crc32c(all, n);
    }
    defaults();
    signal(SIGTERM, on_signal);
    signal(SIGINT, on_signal);
    signal(SIGPIPE, SIG_IGN);
    if (open_pty()) {
        fprintf(stderr, "strange_board: %s\n", strerror(errno));
        return 2;
    }
    note("start spec_hash %08x misbehave %s", spec_hash, *mis_name ? mis_name : "-");
    int64_t last = 0;
    while (!ended) {
        int paced = !lockstep() && tick >= 0;
        int64_t due = tick0_ns + (int64_t)((double)(tick + 1) / RATE * 1e9), t = now_ns();
        int64_t wait = *mis_name ? 1000000 : 50000000;
        if (paced && due - t < wait)
            wait = due > t ? due - t : 0;
        if (slave >= 0 && wait > 10000000) wait = 10000000;
        struct timespec ts = { 0, wait };
        struct pollfd pf = { fd, (short)(POLLIN | (out_n ? POLLOUT : 0)), 0 };
        ppoll(&pf, fd >= 0, &ts, NULL);
        receive();
        if (fd >= 0)
            flush_out();
        t = now_ns();
        for (int k = 0; k < 4 && !lockstep() && tick >= 0 && tick0_ns + (int64_t)((double)(tick + 1) / RATE * 1e9) <= t; k++)
            do_tick();
        if (t - last > 1000000) {
            last = t;
            in_time();
        }
    }
    note("end state %d reason %d armed %ld safe %ld driven %ld driven_after_safe %ld rows %ld drives %ld hellos %ld "
         "fields %ld late %u held %u bad %u lost %u trips %u tick %lld force %d %d rebooted %d", st, reason, armed_count,
         safe_count, driven_ticks, driven_after_safe, rows_sent, drives_rx, hellos, fields_read, late, held, bad_frames,
         lost_seq, trips, (long long)tick, st == RUNNING ? now_.ux : 0, st == RUNNING ? now_.uy : 0, booted_again);
    return 0;
}
