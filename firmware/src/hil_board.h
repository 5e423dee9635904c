/* The board: states, sequence, registers, timing, watchdog and counters. No allocation, no operating system.
 *
 * What brings it from one state to another is the table hil_transitions, which is that of docs/safety.md.
 *
 * Two calls make up a tick, always in this order and both at every tick, whatever the state:
 *
 *     hil_board_sample  row m: the codes just converted, and the drive codes held since tick m - 1
 *     hil_board_drive   the codes to put out now and to hold until tick m + 1
 *
 * They are short, send nothing, and may be called from the sample interrupt. hil_board_frame (the link calls
 * it) and hil_board_poll send, and belong into the main loop; `lock` keeps the two apart.
 */
#ifndef HIL_BOARD_H
#define HIL_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "hil_frame.h"
#include "hil_gain.h"
#include "hil_link.h"
#include "hil_registers.h"
#include "hil_spec.h"

/* So many drives of the host may wait for their ticks. */
#define HIL_WAITING 16u

/* The latency is less than this; a power of two. */
#define HIL_LATENCY 16u

/* Trim outputs, and bytes of a name, at most. */
#define HIL_TRIMS 8u
#define HIL_TRIM_NAME 24u

/* Memory for blocks of up to n samples of `width` bytes a code: one is sent while the next one fills. */
#define HIL_BLOCKS_SIZE(n, width) (2u * (HIL_SENSE_SIZE + (size_t)(n) * HIL_SENSE_COLUMNS * (width)))

typedef struct hil_drive {
    int32_t ux;
    int32_t uy;
} hil_drive;

/* The board's own estimator, which closes the loop in board mode. It is called from hil_board_sample and at ARM, under
 * `lock`. */
typedef struct hil_estimator {
    void (*start)(void *context); /* at ARM: begin anew */
    /* Tick m: the codes just sampled and the drive held over the interval that ends at m. Returns the drive for the
     * interval that begins at m + latency; `drive`: whether it will be applied, or zero in its place. */
    hil_drive (*step)(void *context, int64_t tick, int32_t vx, int32_t vy, hil_drive held, bool drive);
    /* What the last step estimated: `estimated`, the numbers, and HIL_ESTIMATE_FLAGS_VALID. NULL: not said. */
    void (*read)(void *context, hil_estimate *estimate);
    void *context;
} hil_estimator;

typedef struct hil_config {
    hil_identity identity; /* protocol, spec_hash and capabilities are filled in */
    unsigned clocks;       /* 1u << HIL_CLOCK_MODE_... of all that the board can keep; the highest is in force at first */
    hil_link *link;
    uint8_t *blocks;
    size_t blocks_size; /* HIL_BLOCKS_SIZE: bounds the BLOCK register */
    uint64_t (*now_ns)(void *context);
    void (*lock)(void *context, bool locked); /* masks and unmasks the sample interrupt; NULL if there is none */
    /* Put these codes out now, within the interval: the board was stopped, or its limit lowered. Called from the main
     * loop under `lock`, or from hil_board_drive. NULL: they are put out at the next tick. */
    void (*put_now)(void *context, hil_drive codes);
    void *context;
    const hil_estimator *estimator; /* NULL: none, and no board mode */
    /* Trim outputs: what each is (`output` and `outputs` are filled in), and what puts a code out. That is called under
     * `lock`, with 0 for each at the start and whenever the stream ends. */
    const hil_trim_output *trims;
    unsigned trim_count; /* 0: none */
    void (*put_trim)(void *context, unsigned output, int32_t code);
} hil_config;

/* A drive that waits for its tick, or is held. */
typedef struct hil_command {
    hil_drive codes;
    bool limited;
    bool waits;
    int64_t tick;
} hil_command;

typedef struct hil_block {
    uint8_t *payload;
    int64_t tick; /* of the first row */
    uint32_t rows;
    uint8_t flags;
    uint8_t matrix_id;
    bool full; /* to be sent */
} hil_block;

/* All of it is private; look, don't touch. */
typedef struct hil_board {
    hil_config config;
    hil_register_file registers;
    uint8_t situation; /* HIL_SITUATION: the state, and in SAFE what keeps it there */
    uint8_t reason;
    bool greeted; /* the last HELLO since the start matched */
    bool started; /* armed once: ticks count */
    int64_t tick; /* of the last row, -1 before the first */
    /* Registers of the inner loop, as whole numbers. */
    bool lockstep;
    bool gain_mode;
    bool board_mode;
    uint32_t block_rows;
    uint32_t watchdog;
    uint32_t drive_limit;
    uint32_t status_every;
    uint32_t estimate_every;
    /* Timing. */
    hil_command waiting[HIL_WAITING];
    hil_command held;
    hil_gain gain;
    bool driving; /* board mode: what the estimator computes is applied */
    hil_drive computed[HIL_LATENCY]; /* gain and board mode: drives by the tick from which they are held, modulo its length */
    uint8_t interval_flags; /* of the row at which the present interval ends */
    int64_t due;            /* next tick that needs a drive, while RUNNING */
    int64_t fed;            /* tick at which the watchdog was last fed */
    uint32_t granted;       /* lockstep: ticks to go before the host is waited for again */
    uint32_t status_left;   /* ticks to the next unasked STATUS */
    bool status_due;
    uint32_t estimate_left; /* ticks to the next ESTIMATE */
    bool estimate_due;
    hil_estimate estimate;
    /* Blocks. */
    hil_block block[2];
    unsigned filling;
    uint32_t room_rows;
    uint8_t width;
    int32_t sense_max;
    int32_t drive_max;
    /* Counters. */
    uint32_t late;
    uint32_t held_ticks;
    uint32_t undecodable;
    uint32_t lost;
    uint32_t repeated;
    uint32_t saturated;
    uint32_t trips;
    uint32_t dropped;
    uint16_t skipped; /* sequence numbers of dropped blocks, still to be passed over */
    /* Sequence. */
    bool expecting;
    uint16_t expected;
    uint16_t run_next; /* number that would continue a run of frames behind the expected one */
    uint8_t run;       /* frames in that run */
    uint16_t seq;
} hil_board;

/* The board after power-up, in BOOT. False if the configuration cannot work: no link, no time, no clock, a latency
 * of HIL_LATENCY or more, trim outputs that are none, a tick rate that is not positive, a converter of less than 2 or more than 24 bits, or memory
 * for less than one row. */
bool hil_board_init(hil_board *board, const hil_config *config);

/* Take an intact frame from the host, and answer it. */
void hil_board_frame(hil_board *board, const hil_frame *frame);

/* Tick m: the sense codes just converted; `clipped` if the converter was at its end. */
void hil_board_sample(hil_board *board, int32_t vx, int32_t vy, bool clipped);

/* Tick m, right after the sample: the drive codes from now until the next tick. */
hil_drive hil_board_drive(hil_board *board);

/* Send what is ready: a full block, a due STATUS, a due ESTIMATE. */
void hil_board_poll(hil_board *board);

/* Zero force and SAFE, for reasons of the board's own: HIL_SAFE_REASON_LINK_LOST when the host has hung up (of a board
 * that streams), HIL_SAFE_REASON_FAULT when a protection of yours trips. It cannot be armed until
 * hil_board_fault_gone. Both from the main loop, as they use `lock`. */
void hil_board_safe(hil_board *board, uint8_t reason);
void hil_board_fault_gone(hil_board *board);

/* State as in STATUS. */
uint8_t hil_board_state(const hil_board *board);

/* Whether SENSE is due at every tick. */
bool hil_board_streaming(const hil_board *board);

/* Whether the board waits for the host between ticks. */
bool hil_board_lockstep(const hil_board *board);

/* In lockstep: whether the host has answered, so that the next tick may come. */
bool hil_board_may_go_on(const hil_board *board);

#endif
