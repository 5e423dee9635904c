/* Gain mode: the loop the board closes itself, with the matrix of the host.
 *
 *     s[m] = A s[m - 1] + B V[m] + C V[m - D]                                   for each axis
 *     u    = limited(rounded(G [sx sx' sy sy'] + b + d[m]))
 *
 * from s = 0 and V = 0 at ARM; d is dither from a shift register. In single precision: about fifty
 * multiplications a sample.
 */
#ifndef HIL_GAIN_H
#define HIL_GAIN_H

#include <stdbool.h>
#include <stdint.h>

#include "hil_registers.h"
#include "hil_spec.h"

#define HIL_HISTORY 64u /* codes remembered: more than FILTER_DELAY reaches back; a power of two */

typedef struct hil_gain {
    float a[2][2];
    float b[2];
    float c[2];
    uint32_t delay;
    float dither;
    float limit;
    uint32_t shift; /* register of the dither */
    float s[2][2];  /* of each axis */
    float past[HIL_HISTORY][2];
    bool closed; /* a matrix is in force */
    hil_drive_gains matrix;
    bool waits; /* another one waits for its tick */
    hil_drive_gains waiting;
    int64_t waiting_tick;
} hil_gain;

/* At ARM: filter, history and dither from their start, no matrix. */
void hil_gain_start(hil_gain *gain, const hil_register_file *registers);

/* Take over what may change while the loop runs: dither, and the largest code. */
void hil_gain_obey(hil_gain *gain, const hil_register_file *registers, uint32_t limit);

/* Whether the filter in the registers may run: the spectral radius of A is at most HIL_FILTER_RADIUS. */
bool hil_gain_stable(const hil_register_file *registers);

/* Whether all of a matrix is within HIL_GAINS_LIMIT, and it has a name. */
bool hil_gain_accepts(const hil_drive_gains *matrix);

/* Have a matrix wait for its tick, in place of one that waits already. */
void hil_gain_put(hil_gain *gain, const hil_drive_gains *matrix, int64_t tick);

/* From the codes just sampled at a tick the drive codes they lead to; returns whether they had to be limited. */
bool hil_gain_step(hil_gain *gain, int64_t tick, int32_t vx, int32_t vy, int32_t drive[2]);

/* Name of the matrix in force, 0 for none. */
uint8_t hil_gain_matrix_id(const hil_gain *gain);

#endif
