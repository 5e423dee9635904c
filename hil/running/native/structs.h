/* What Python and the turn share. hil/running/native/__init__.py has the same structures, and compares their sizes. */

#ifndef TURN_STRUCTS_H
#define TURN_STRUCTS_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "../../../firmware/src/hil_frame.h" /* the wire, generated from its spec */

#define EXPORT __attribute__((visibility("default"))) /* Python calls it, too */

#define READ_SIZE 4096 /* bytes taken in one read at most */
#define REST_SIZE ((HIL_MAX_ENCODED + READ_SIZE + 7u) / 8u * 8u)
#define NONE INT64_MIN /* in place of a tick */
#define SENT 4096      /* drives remembered, by effective tick */

/* One sample. */
typedef struct {
    int64_t tick;
    int32_t codes[4]; /* vx, vy, ux, uy */
    int32_t flags;
    int16_t matrix; /* gain mode: the one that its SENSE names */
    int16_t left;   /* rows of its SENSE, from this one on */
} row_t;

/* The receiving direction: hil.wire.framing.Decoder and hil.wire.stream.Receiver. */
typedef struct {
    int64_t bytes, frames, cobs_errors, too_short, crc_errors, oversize, dropped_bytes;
    int64_t lost, repeated, undecodable, passed_over;
    int64_t tick;
    int64_t expected; /* sequence number, NONE before the first */
    int64_t run, run_next;
    int64_t skipping;
    int64_t held; /* bytes of `rest` that wait for a delimiter */
    uint8_t rest[REST_SIZE];
} receiver_t;

#define RECORD_SIZE 72u /* struct canfd_frame; the kernel's classic struct can_frame is its beginning */
#define PART_ROOM (HIL_CAN_MOST - HIL_CAN_PART_SIZE)

/* The frames of CAN, in place of those of a byte stream: hil.wire.can_format.CanDecoder. */
typedef struct {
    int64_t bytes, frames, malformed, broken;
    int64_t node;
    int64_t unfinished; /* type << 16 | seq of the message whose parts are being joined; NONE */
    int64_t joined;     /* bytes */
    uint8_t parts[256u * PART_ROOM];
} can_t;

/* A message that is no sample; its payload follows, filled up to eight bytes. */
typedef struct {
    int64_t received_ns;
    int64_t tick;
    int32_t type, seq, size, reserved;
} said_t;

/* Where what was received goes. */
typedef struct {
    row_t *rows;
    int64_t row_room, row_count;
    uint8_t *said;
    int64_t said_room, said_size;
    const int32_t *sizes; /* of the payload of each type: −1 unknown, with OPEN_ENDED at least so many */
} batch_t;

#define OPEN_ENDED 0x10000

/* Where the rows of one record file go: a ring in shared memory, or rows that Python takes over. */
typedef struct {
    uint8_t *rows;
    int64_t row_size, capacity;
    int64_t head;      /* rows appended */
    int64_t tail;      /* rows taken out, as last known */
    int64_t *written;  /* both indices as the reader sees them; NULL where Python takes over */
    const int64_t *read;
    int64_t *dropped;
    int64_t waits; /* 1: a full one is waited for (lockstep) */
} track_t;

/* Which drives were sent, and whether SENSE shows them: hil.running.loop.force. */
typedef struct {
    int64_t tick;
    int32_t u[2];
} drive_t;

typedef struct {
    int64_t latency, limit;
    int64_t due;  /* tick of the first interval that must be driven */
    int64_t last; /* tick of the row before; NONE */
    int32_t shown[2];
    int64_t odd; /* what is wrong with a row: ODD_… */
    int64_t odd_tick;
    int32_t odd_shown[2], odd_meant[2];
    drive_t sent[SENT];
} echo_t;

enum { ODD_NOTHING, ODD_HELD, ODD_UNSENT, ODD_OTHER };

/* Which matrices were sent in gain mode, and whether SENSE may name one: hil.running.loop.gain. */
typedef struct {
    int64_t block;
    int64_t *effective; /* first tick that each is meant for */
    int64_t room, count;
    int64_t armed;    /* how many were sent before ARM */
    int64_t in_force; /* NONE */
    int64_t odd;      /* what is wrong with a SENSE: MATRIX_… */
    int64_t odd_tick, odd_name, odd_begin, odd_count, odd_effective;
} matrices_t;

enum { MATRIX_FINE, MATRIX_NONE, MATRIX_UNSENT, MATRIX_EARLY };

/* A row of gain mode's ledger, before it is known when the matrix came into force. */
typedef struct {
    int64_t matrix, effective;
    int64_t row[5]; /* hil.records.timing.ledger_layout */
} sent_t;

#define LATER 64  /* matrices whose effect is still to be seen */
#define RECENT 16 /* of those whose lateness the next is made for */

/* How gain mode answers. */
typedef struct {
    void (*solve)(void *folding, int64_t horizon, int64_t ahead); /* into gain and bias */
    void *folding;
    double *gain, *bias;
    /* the board's law on the host, for gaps */
    void (*follow)(void *board, int64_t first, const int32_t *codes, int64_t rows, int64_t columns);
    void (*tell)(void *board, const double *gain, const double *bias, int64_t effective);
    void *board;
    matrices_t *matrices;
    int64_t lead, horizon;
    int64_t late[RECENT], late_count; /* ticks by which matrices came into force too late */
    int64_t first, count;             /* of `sent` */
    sent_t sent[LATER];
} gains_t;

/* How board mode answers. */
typedef struct {
    int64_t limit;     /* DRIVE_LIMIT */
    int64_t permitted; /* to drive, since it was armed */
    int64_t odd, odd_tick, odd_drive;
} permit_t;

enum { PERMIT_FINE, PERMIT_BEYOND, PERMIT_DRIVES };

/* Samples in blocks: observed whole, of those at hand the newest answered. */
typedef struct {
    void (*observe)(void *context, int64_t n, const double *z, const double *u, double *outputs);
    double *z, *u, *outputs;       /* of as many samples as a SENSE may have */
    double code[4], unit[4];       /* SI of a code; of a scaled unit */
    int64_t rows;                  /* of a block */
    int64_t every, since;          /* samples from estimate to estimate, and those after the last */
    int64_t covariance_every;      /* blocks */
    int64_t count;                 /* that were observed */
    int64_t closed;                /* the loop */
    int64_t began;                 /* tick of the first row since ARM, with which a block begins; NONE */
    int64_t clip, saturation;      /* codes at the end of the converter, and of the drive */
} blocks_t;

/* How samples are answered. */
enum { MODE_FORCE, MODE_GAIN, MODE_BOARD };

typedef void (*tick_fn)(void *context, double vx, double vy, double ux, double uy, double codes[2]);

/* How bytes come and go. */
enum { LINK_STREAM, LINK_DATAGRAM, LINK_CAN, LINK_BYTES, LINK_MEMORY };

#define ANSWER_ROOM 65536 /* bytes that a board in this process may say to one drive: hil/wire/inproc.py */

typedef struct {
    int64_t kind;
    int64_t fd;      /* to read from; −1 for none */
    int64_t waker;   /* becomes readable when a signal has come; −1 for none */
    int64_t failure; /* errno of a link that closed, 0 for a hang-up */
    int64_t strangers;
    int64_t trouble; /* identifier of an error frame of CAN; 0 */
    uint32_t peer_ip, group_ip; /* in network order */
    uint16_t peer_port, group_port;
    uint32_t reserved;
    /* LINK_BYTES, by Python; −1: it raised */
    int64_t (*receive)(int64_t timeout_ns, uint8_t *data, int64_t room);
    int64_t (*send)(const uint8_t *data, int64_t size);
    /* LINK_MEMORY: a board in this process. What it does not answer itself goes to Python, and then all that follows
       until Python has been read empty. */
    int64_t (*answer)(void *board, const uint8_t *data, int64_t size, uint8_t *to); /* −1: not this, nothing changed */
    void *board;
    int64_t elsewhere; /* Python may have bytes that are to be read first */
    int64_t answered, taken; /* bytes of `answers` that it has put down; that were read */
    uint8_t answers[ANSWER_ROOM];
} link_t;

enum { TRACK_CAPTURE, TRACK_TIMING, TRACK_INNOVATION, TRACKS };

/* One run, as far as its samples are concerned. */
typedef struct {
    receiver_t *receiver;
    can_t *can; /* NULL on a byte stream */
    batch_t batch;
    link_t link;
    int64_t mode;
    echo_t *echo; /* force mode */
    blocks_t *blocks;
    gains_t *gains;
    permit_t *permit;
    track_t tracks[TRACKS];
    int64_t (*room)(int64_t track); /* room in a full one: 1 there is, 0 there is not, −1 Python raised */

    /* observer and control law */
    tick_fn step;
    void *context;
    const double *newest;          /* its output of the newest sample: innovation (2), variance (2), … */
    const double *state;           /* (states,) */
    const double *covariance;      /* (estimated, estimated) */
    double *queue;                 /* (latency + 1, 3) what was commanded */
    int64_t states, estimated, outputs;
    int64_t latency;
    double volts[2], noise[2];     /* of the innovation's unit; sense noise in that unit */

    /* estimates kept until Python records them: tick, state, variances, output */
    double *estimates;
    int64_t estimate_room, estimate_count;
    double *covariances; /* likewise: tick, covariance */
    int64_t covariance_room, covariance_count;
    int64_t estimate_every, covariance_every;

    /* rows kept for those who look at each: the opening of a run, hindsight after a gap */
    row_t *seen;
    int64_t seen_count;
    int64_t look_after; /* return after so many */

    /* answering */
    uint8_t *types; /* of the frames that were sent, by number */
    int64_t seq;
    int64_t code_limit;
    int64_t lockstep;
    int64_t slice_ns;      /* longest wait for samples */
    int64_t suspicious_ns; /* between two answers, from which on it counts as silence */
    int64_t at_once_ns;    /* samples that come within it had been waiting */

    /* where the run stands */
    int64_t goal;   /* return at the end of a read with so many ticks done */
    int64_t due;    /* return before the first sample that is so many ticks from the first */
    int64_t stale;  /* rows up to this tick are from before the board was armed again */
    int64_t first, next;
    int64_t row_at; /* of the batch, the next to be taken */
    int64_t fresh;  /* the rows at hand came while nothing was to be answered: they are a read of their own */
    int64_t news;   /* messages came since this was last told */
    int32_t shown[2];
    int64_t received_ns, answered_ns, sent_ns;
    int64_t silence_ns; /* longest between two answers, where suspicious */
    int64_t turns, behind, drives;
    int64_t samples, held, clipped, saturated, residual_safe;
    int64_t held_longest, held_run, held_next;
    double residual, residual_limit;
    int64_t guarded; /* sample from which the residual may stop the run */
    int64_t stop;
    int64_t failed; /* Python raised within a call */
    double refused[2]; /* what was not sent */
} turn_t;

/* Why a call returns. */
enum {
    TURN_DONE,       /* the goal is reached, or the run is to stop; the samples at hand are answered */
    TURN_QUIET,      /* no sample came */
    TURN_NEWS,       /* something came beside samples, which are answered */
    TURN_GAP,        /* samples are missing before the next row, or it is from the past */
    TURN_DUE,        /* before the sample that `due` names */
    TURN_ODD,        /* the board shows what it was not told */
    TURN_LOOK,       /* after as many rows as asked for */
    TURN_FULL,       /* there is no room for more estimates, or matrices */
    TURN_WOKEN,      /* a signal came */
    TURN_CLOSED,     /* the link is closed */
    TURN_FAILED,     /* Python raised */
    TURN_BEYOND,     /* the control law gave what may not be sent */
};

#endif
