/* A board without an operating system: what there is to write besides the library. docs/connect-your-board.md goes
 * through it. The functions declared first are yours: a UART with a ring buffer, two converters, a timer. */
#include "hil_board.h"
#include "hil_serial.h"

size_t uart_room(void);                              /* bytes the transmit ring can take now */
void uart_write(const uint8_t *data, size_t size);   /* into the ring; there is room */
size_t uart_read(uint8_t *data, size_t size);        /* what has arrived, at most size; does not wait */
int32_t adc_code(unsigned axis);                     /* signed, full scale is 1 << (sense_bits - 1) */
void dac_put(unsigned axis, int32_t code);           /* signed, full scale is 1 << (drive_bits - 1) */
uint64_t timer_ns(void);                             /* since power-up */
void sample_interrupt(bool enabled);                 /* masks and unmasks it */
bool overheated(void);                               /* or whatever else must stop the board */
void board_start(void);
void board_loop(void);
void on_sample(void);

static hil_board board;
static hil_serial serial;
static uint8_t blocks[HIL_BLOCKS_SIZE(64, 2)]; /* up to 64 samples in a block, 2 bytes a code */

static size_t room(void *context) {
    (void)context;
    return uart_room();
}

static void write(void *context, const uint8_t *data, size_t size) {
    (void)context;
    uart_write(data, size);
}

static uint64_t now_ns(void *context) {
    (void)context;
    return timer_ns();
}

static void lock(void *context, bool locked) {
    (void)context;
    sample_interrupt(!locked);
}

/* Within an interval, not at the next tick: the board was stopped, or its limit lowered. */
static void put_now(void *context, hil_drive drive) {
    (void)context;
    dac_put(0, drive.ux);
    dac_put(1, drive.uy);
}

void board_start(void) {
    hil_config config = {0};
    config.identity.unique_id = 1;
    config.identity.firmware = 0x00010000;        /* 1.0.0 */
    config.identity.tick_rate_Hz = 4000.0;        /* samples per second */
    config.identity.axes = 2;
    config.identity.sense_bits = 16;
    config.identity.drive_bits = 12;
    config.identity.sense_scale_V = 2.5 / 32768;  /* +-2.5 V at the converter, in volts per code */
    config.identity.drive_scale_mps2 = 8.0 / 2048; /* force per mass at full scale, per code */
    config.identity.latency_ticks = 1;
    config.clocks = 1u << HIL_CLOCK_MODE_REAL;
    config.link = &serial.link;
    config.blocks = blocks;
    config.blocks_size = sizeof blocks;
    config.now_ns = now_ns;
    config.lock = lock;
    config.put_now = put_now;
    hil_serial_init(&serial, room, write, NULL);
    if (!hil_board_init(&board, &config))
        for (;;) { /* the configuration cannot work */
        }
    sample_interrupt(true);
}

/* The sample interrupt: tick m. */
void on_sample(void) {
    hil_board_sample(&board, adc_code(0), adc_code(1), false);
    hil_drive drive = hil_board_drive(&board);
    dac_put(0, drive.ux);
    dac_put(1, drive.uy);
}

/* The main loop, for ever. */
void board_loop(void) {
    uint8_t data[64];
    size_t size = uart_read(data, sizeof data);
    hil_serial_receive(&serial, &board, data, size);
    if (overheated())
        hil_board_safe(&board, HIL_SAFE_REASON_FAULT);
    else
        hil_board_fault_gone(&board);
    hil_board_poll(&board);
}
