/* Plant, sense chain, converters and loop of an angle-measuring gyro on one chip; SI, forces per unit mass.
 *
 * The module that compiles this puts its effects in the places marked with @, and the names of cfg_t in the order of its
 * own. The plant is integrated by Dormand and Prince's pair of order 5(4) (J. Comp. Appl. Math. 6, 1980) with control of
 * the local error; an interval is cut where a delayed drive switches and where a late channel samples. A kink of a law
 * (friction, a stop) is met by steps that the error makes small. */
#include <math.h>
#include <string.h>

enum { STATES = 14, COEFFICIENTS = 6, COLUMNS = 10 };

typedef struct {
    double @CONFIG@;
} cfg_t;

typedef struct { /* what holds during a piece of an interval */
    const cfg_t *g;
    const double *base; /* kxx kyy kxy [1/s2], dxx dyy dxy [1/s] */
    const double *coefficients;
    const int *on;
    double t0, rate, spin, warm, warming; /* at t0, and their slopes */
    double ux, uy, nx, ny, lastx, lasty;  /* drive, noise force, drive that acted at the end of the interval before */
    int n;                                /* states in use */
} now_t;

static double clamp(double v, double limit) { return v > limit ? limit : v < -limit ? -limit : v; }

static void rhs(const now_t *q, double t, const double *s, double *o) {
    const double *b = q->base;
    const double x = s[0], vx = s[1], y = s[2], vy = s[3], ux = q->ux, uy = q->uy;
    const double dt = t - q->t0, W = q->rate + q->spin * dt, warm = q->warm + q->warming * dt;
    const double A = q->g->A, w0 = q->g->w0, lastx = q->lastx, lasty = q->lasty;
    double Fx = ux + q->nx - b[0] * x - b[2] * y - b[3] * vx - b[5] * vy + 2 * W * vy + W * W * x + q->spin * y;
    double Fy = uy + q->ny - b[2] * x - b[1] * y - b[5] * vx - b[4] * vy - 2 * W * vx + W * W * y - q->spin * x;
    if (q->n > 4) memset(o + 4, 0, (STATES - 4) * sizeof *o);
    (void)A, (void)w0, (void)warm, (void)lastx, (void)lasty;
    @FORCES@
    o[0] = vx, o[1] = Fx, o[2] = vy, o[3] = Fy;
}

/* Displacements that the channels show at t, each of the state at the instant at which its channel looked. */
static void sense(const now_t *q, double t, const double *sx, const double *sy, double *shown) {
    const double x = sx[0], y = sy[2], ux = q->ux, uy = q->uy, warm = q->warm + q->warming * (t - q->t0), A = q->g->A;
    double X = x, Y = y;
    (void)ux, (void)uy, (void)warm, (void)A;
    @SENSES@
    shown[0] = X, shown[1] = Y;
}

/* From t to end, the state in place; h is the step tried first and is left for the next piece. */
static void advance(const now_t *q, double *s, double t, double end, double *h, const double *tolerance) {
    static const double a[7][6] = {
        {0},
        {1. / 5},
        {3. / 40, 9. / 40},
        {44. / 45, -56. / 15, 32. / 9},
        {19372. / 6561, -25360. / 2187, 64448. / 6561, -212. / 729},
        {9017. / 3168, -355. / 33, 46732. / 5247, 49. / 176, -5103. / 18656},
        {35. / 384, 0, 500. / 1113, 125. / 192, -2187. / 6784, 11. / 84}};
    static const double c[7] = {0, 1. / 5, 3. / 10, 4. / 5, 8. / 9, 1, 1};
    static const double e[7] = {71. / 57600, 0, -71. / 16695, 71. / 1920, -17253. / 339200, 22. / 525, -1. / 40};
    const double least = 1e-9 * q->g->Ts;
    double k[7][STATES], w[STATES];
    int steps = 0;
    if (end - t <= least) return;
    rhs(q, t, s, k[0]);
    while (end - t > least) {
        if (!(fabs(s[0]) + fabs(s[2]) < 50 * q->g->A) || steps++ > 4000) { /* ran away, or too stiff to follow */
            s[0] = NAN;
            return;
        }
        const int last = *h >= end - t;
        const double step = last ? end - t : *h;
        double error = 0;
        for (int i = 1; i < 7; i++) {
            for (int j = 0; j < q->n; j++) {
                double sum = 0;
                for (int l = 0; l < i; l++) sum += a[i][l] * k[l][j];
                w[j] = s[j] + step * sum;
            }
            rhs(q, t + c[i] * step, w, k[i]);
        }
        for (int j = 0; j < q->n; j++) {
            double sum = 0;
            for (int i = 0; i < 7; i++) sum += e[i] * k[i][j];
            error = fmax(error, fabs(step * sum) / tolerance[j]);
        }
        if (error <= 1 || step <= least) {
            memcpy(s, w, q->n * sizeof *s);
            memcpy(k[0], k[6], q->n * sizeof *s);
            t += step;
        }
        const double better = step * fmin(4, fmax(0.2, 0.9 * pow(error + 1e-12, -0.2)));
        if (!last || error > 1 || better > *h) *h = fmax(better, least); /* a short last step says nothing of h */
    }
}

typedef struct { /* the chip: per axis position, velocity over w0 and offset of the filter; the matrix of a block */
    double f[2][3], gain[2][4], modulation, energy, quadrature, sum, count;
} chip_t;

static double converted(double v, double lsb, double range) { return clamp(lsb * rint(v / lsb), range); }

/* One sample of the loop: filter the volts, once a block set the matrix, give the drive that acts from latency on. */
static void turn(chip_t *chip, const cfg_t *g, long m, const double *volts, const double *dither, double *drive) {
    const double wt = g->w0 * g->Ts, ahead = (g->latency + 0.5) * wt, gains[2] = {g->Gx, g->Gy};
    double z[4];
    for (int a = 0; a < 2; a++) {
        double *f = chip->f[a];
        const double p = cos(wt) * f[0] + sin(wt) * f[1], v = cos(wt) * f[1] - sin(wt) * f[0];
        const double e = volts[a] / gains[a] - p - f[2];
        f[0] = p + g->l1 * e, f[1] = v + g->l2 * e, f[2] += g->l3 * e;
        z[2 * a] = cos(ahead) * f[0] + sin(ahead) * f[1], z[2 * a + 1] = cos(ahead) * f[1] - sin(ahead) * f[0];
    }
    chip->energy += z[0] * z[0] + z[1] * z[1] + z[2] * z[2] + z[3] * z[3];
    chip->quadrature += z[0] * z[3] - z[2] * z[1];
    chip->count++;
    if (m % (long)g->block == (long)g->block - 1) {
        const double swing = sin(2 * M_PI * g->modulation_Hz * m * g->Ts);
        const double aim = g->A * (1 + g->modulation * (g->square ? (swing > 0 ? 1 : -1) : swing));
        const double excess = clamp(chip->energy / chip->count / (aim * aim) - 1, 1);
        const double out_of_line = clamp(chip->quadrature / chip->count / (aim * aim), 0.2);
        chip->sum = clamp(chip->sum + 0.1 * g->energy_gain * excess, 0.05);
        const double damp = g->w0 * clamp(g->energy_gain * excess + chip->sum, 0.1);
        const double twist = g->w0 * g->w0 * g->quadrature_gain * out_of_line;
        const int back = g->reversal > 0 && ((long)floor(m * g->Ts / g->reversal + 0.5) & 1);
        const double turning = 2 * g->virtual_rotation * (back ? -1 : 1);
        const double matrix[2][4] = {
            {g->trim_kxx, g->w0 * (g->trim_dxx - damp), g->trim_kxy + twist, g->w0 * (g->trim_dxy + turning)},
            {g->trim_kxy - twist, g->w0 * (g->trim_dxy - turning), g->trim_kyy, g->w0 * (g->trim_dyy - damp)}};
        memcpy(chip->gain, matrix, sizeof matrix);
        chip->energy = chip->quadrature = chip->count = 0;
    }
    for (int a = 0; a < 2; a++) {
        double u = dither[a];
        for (int j = 0; j < 4; j++) u += chip->gain[a][j] * z[j];
        drive[a] = converted(u, g->dac_lsb, g->full_scale);
    }
}

/* n samples from t on. rate, warm: n + 1 values, straight between samples; force, noise, dither: (n, 2). With given, that
 * (n, 2) is the drive and no loop runs. A row of out: volts, drive, state at the sample, displacements shown. */
void run(const cfg_t *g, const double *base, const int *on, const double *coefficients, const double *tolerance, int states,
         long n, double t, const double *rate, const double *warm, const double *force, const double *noise,
         const double *dither, const double *given, double *state, double *out) {
    now_t q = {.g = g, .base = base, .coefficients = coefficients, .on = on, .n = states};
    chip_t chip = {0};
    double queue[8][2] = {{0}}, late[2] = {0}, h = g->Ts / 8;
    for (long m = 0; m < n; m++, out += COLUMNS) {
        const double begin = t + m * g->Ts, end = t + (m + 1) * g->Ts;
        const double *u = given ? given + 2 * m : queue[m & 7];
        const double stops[5] = {begin + g->tux, begin + g->tuy, end - g->tsx, end - g->tsy, end};
        double sx[STATES], sy[STATES], at = begin;
        int done[5] = {0};
        q.t0 = begin, q.rate = rate[m], q.spin = (rate[m + 1] - rate[m]) / g->Ts;
        q.warm = warm[m], q.warming = (warm[m + 1] - warm[m]) / g->Ts;
        q.nx = force ? force[2 * m] : 0, q.ny = force ? force[2 * m + 1] : 0;
        q.ux = late[0], q.uy = late[1];
        for (int i = 0; i < 5; i++) {
            int next = -1;
            for (int j = 0; j < 5; j++)
                if (!done[j] && (next < 0 || stops[j] < stops[next])) next = j;
            advance(&q, state, at, stops[next], &h, tolerance);
            at = stops[next], done[next] = 1;
            if (next == 0) q.ux = u[0];
            if (next == 1) q.uy = u[1];
            if (next == 2) memcpy(sx, state, sizeof sx);
            if (next == 3) memcpy(sy, state, sizeof sy);
        }
        late[0] = u[0], late[1] = u[1];
        q.lastx = q.lastx + clamp(u[0] - q.lastx, g->slew * g->Ts);
        q.lasty = q.lasty + clamp(u[1] - q.lasty, g->slew * g->Ts);
        q.ux = u[0], q.uy = u[1];
        sense(&q, end, sx, sy, out + 8);
        out[0] = converted(g->Gx * out[8] + g->offset_x + (noise ? noise[2 * m] : 0), g->adc_lsb, g->adc_range);
        out[1] = converted(g->Gy * out[9] + g->offset_y + (noise ? noise[2 * m + 1] : 0), g->adc_lsb, g->adc_range);
        out[2] = u[0], out[3] = u[1];
        memcpy(out + 4, state, 4 * sizeof *state);
        if (!given && m >= g->armed) turn(&chip, g, m, out, dither + 2 * m, queue[(m + 1 + (long)g->latency) & 7]);
    }
}

/* For the self-check: the right-hand side, with everything but state and time held. */
void slope(const cfg_t *g, const double *base, const int *on, const double *coefficients, int states, double t0,
           const double *held, double t, const double *state, double *out) {
    now_t q = {g,       base,    coefficients, on,      t0, held[0], held[1], held[2],
               held[3], held[4], held[5],      0,       0,  held[6], held[7], states};
    rhs(&q, t, state, out);
}
