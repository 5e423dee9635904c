/* The springs, for trim electrodes to null: what the phase loop follows along the frame, and the quadrature loop across it.

   With c, s = cos, sin of twice the frame's angle, and at rest against each other

       omega^2 = (kxx + kyy)/2 + (kxx - kyy)/2 c + kxy s        coupling = kxy c - (kxx - kyy)/2 s

   least squares with a memory.  A frame that stands still shows two of three: then the deviations say so.  While it turns
by w, both loops lag what they follow by (2 w)^2 / (gain corner) of the split, as filters of second type do. */

#ifndef CLASSIC_SPRINGS_H
#define CLASSIC_SPRINGS_H

#include "loops.h"

#define REMEMBERED 40.0 /* time constants of the slowest of both loops */

typedef struct {
    bool told;          /* of trim voltages: without them nobody asks */
    double softened[3]; /* 1/s2, by them */
    double information[3][3], right[3], square, weight; /* of the springs at 0 V */
    double lag;                                         /* mean, of the split */
    double springs[3], deviation[3];
} spring_fit;

static void learn(spring_fit *own, const double row[3], double value)
{
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            own->information[i][j] += row[i] * row[j];
        own->right[i] += row[i] * value;
    }
    own->square += value * value;
    own->weight += 1.0;
}

static void solve(spring_fit *own, double repeated)
{
    double (*m)[3] = own->information, inverse[3][3], left = own->square;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }
    double determinant = m[0][0] * inverse[0][0] + m[0][1] * inverse[1][0] + m[0][2] * inverse[2][0];
    for (int i = 0; i < 3; i++) {
        double at_zero = 0.0;
        for (int j = 0; j < 3; j++)
            at_zero += inverse[i][j] / determinant * own->right[j];
        left -= at_zero * own->right[i];
        own->springs[i] = at_zero - own->softened[i];
    }
    double late = own->lag * hypot(0.5 * (own->springs[0] - own->springs[1]), own->springs[2]);
    for (int i = 0; i < 3; i++)
        own->deviation[i] = hypot(sqrt(fmax(left, 0.0) / own->weight * repeated * inverse[i][i] / determinant), late);
}

/* One sample of the running loops. */
static void follow_springs(spring_fit *own, const loops *in)
{
    if (!own->told)
        return;
    double slowest = fmin(in->frequency.gain, in->quadrature.gain), keep = exp(-slowest / REMEMBERED * in->step_s);
    double c = cos(2.0 * in->frame), s = sin(2.0 * in->frame), declared = in->nominal * in->nominal;
    const double along[3] = {0.5 * (1.0 + c), 0.5 * (1.0 - c), s}, across[3] = {-0.5 * s, 0.5 * s, c};
    double stiff = fmin(in->frequency.gain * in->frequency.corner, in->quadrature.gain * in->quadrature.corner);
    own->lag += (4.0 * in->turning * in->turning / stiff - own->lag) * (1.0 - keep);
    double values[2] = {in->omega * in->omega - declared, 2.0 * in->omega * in->quadrature_rate};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            own->information[i][j] *= keep;
        own->right[i] *= keep;
        values[0] += along[i] * own->softened[i];
        values[1] += across[i] * own->softened[i];
    }
    own->square *= keep;
    own->weight *= keep;
    learn(own, along, values[0]); /* less one spring for both axes, so that squares keep their digits */
    learn(own, across, values[1]);
    solve(own, 2.0 / (slowest * in->step_s));
    own->springs[0] += declared;
    own->springs[1] += declared;
}

/* The voltages have changed: the loops are where they belong before they see it. */
static void soften(spring_fit *own, loops *in, const gyro_plugin_trims *trims)
{
    double change[3];
    own->told = trims->count > 0;
    for (int i = 0; i < 3; i++) {
        change[i] = trims->softened_per_s2[i] - own->softened[i];
        own->softened[i] = trims->softened_per_s2[i];
        in->device.stiffness_per_s2[i] -= change[i];
    }
    in->coupled -= (change[2] - 0.5 * I * (change[0] - change[1])) * in->device.amplitude_m / (2.0 * in->nominal);
}

#endif
