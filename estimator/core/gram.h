/* A'A of a tall matrix, in vector registers and on one core: beside a running loop a library's own threads would wait for
   one another. */
#ifndef GYRO_GRAM_H
#define GYRO_GRAM_H

#include "lanes.h"

#define GRAM_BLOCK 12 /* the width of the matrix is a multiple of it */
#define GRAM_ROWS 4
#define GRAM_PANEL 64 /* rows that stay in the cache while all of their products are taken */

/* Add to four rows of products, from (i, k) on in blocks of 12 columns, those of the rows first to last of a. */
static void add_block(const real *a, whole first, whole last, whole width, whole i, whole k, real *out)
{
    four sum[GRAM_ROWS][3];
    for (int r = 0; r < GRAM_ROWS; r++)
        for (int c = 0; c < 3; c++)
            sum[r][c] = take4(out + (i + r) * width + k + 4 * c);
    for (whole row = first; row < last; row++) {
        const real *at = a + row * width;
        four right[3] = {take4(at + k), take4(at + k + 4), take4(at + k + 8)};
        for (int r = 0; r < GRAM_ROWS; r++)
            for (int c = 0; c < 3; c++)
                sum[r][c] = add4(sum[r][c], scale4(at[i + r], right[c]));
    }
    for (int r = 0; r < GRAM_ROWS; r++)
        for (int c = 0; c < 3; c++)
            put4(out + (i + r) * width + k + 4 * c, sum[r][c]);
}

/* out (width, width) += A'A of a (rows, width); blocks below the diagonal are not filled. */
static void add_gram(const real *a, whole rows, whole width, real *out)
{
    for (whole first = 0; first < rows; first += GRAM_PANEL) {
        whole last = first + GRAM_PANEL < rows ? first + GRAM_PANEL : rows;
        for (whole i = 0; i < width; i += GRAM_ROWS)
            for (whole k = i - i % GRAM_BLOCK; k < width; k += GRAM_BLOCK)
                add_block(a, first, last, width, i, k, out);
    }
}

#endif
