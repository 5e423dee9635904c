/* The observer's step by hand in C: flow with sensitivities, fading memory with the covariance P that the gain comes
 * from and the covariance C that the estimates have, stabilised forgetting, the pattern angle and its variance.
 *
 * What a C programmer writes who knows that F = [Fs Fc; 0 I] and that covariances are symmetric, without intrinsics.
 * ACTIVE lists the K constants that are estimated, of Φx Φy Ω kxx kyy kxy dxx dyy dxy.
 */
#include <math.h>
#include <string.h>

#define S 4
#define N (S + K)
#define CONSTANTS 9
#define COLUMNS 12

static const int active[K] = {ACTIVE};

typedef struct {
    double h, fade, force[2], noise[2], intensity[CONSTANTS], prior[CONSTANTS], spread[CONSTANTS], initial[CONSTANTS];
    double virtual_rate, reference;
    long order;
    double x[S + CONSTANTS], p[N * N], c[N * N];
    double nis, time, cross[N], variance, gradient[4];
    long cursor, started, referred;
    double theta, theta_zero, theta_plain, theta_plain_zero, forced, rotation, rate, rate_integral, virtual_integral;
} filter;

static double pattern(const double *s, double w, double rate, double *energy, double *momentum)
{
    double x = s[0], y = s[2], vx = s[1] - w * y, vy = s[3] + w * x, k = 1.0 + w * w - rate * rate;
    *energy = 0.5 * (k * (x * x + y * y) + vx * vx + vy * vy);
    *momentum = x * vy - y * vx;
    return atan2(2.0 * (k * x * y + vx * vy), k * (x * x - y * y) + (vx * vx - vy * vy));
}

static double nearest(double twice, double before)
{
    double theta = 0.5 * twice;
    return theta + M_PI * floor((before - theta) / M_PI + 0.5);
}

/* Columns: the state, its derivative by itself and by Ω k d, whether estimated or not. */
static void drift(const double *c, const double *u, double h, long order, double total[S][COLUMNS])
{
    double a[S][COLUMNS], b[S][COLUMNS];
    double w = c[2], kxx = c[3] - w * w, kyy = c[4] - w * w, kxy = c[5], dxx = c[6], dyy = c[7], dxy = c[8];
    memcpy(a, total, sizeof a);
    for (long n = 0; n < order; n++) {
        double scale = h / (n + 1), x = a[0][0], vx = a[1][0], y = a[2][0], vy = a[3][0];
        double push_x[COLUMNS] = {n ? 0 : u[0], 0, 0, 0, 0, 2 * w * x + 2 * vy, -x, 0, -y, -vx, 0, -vy};
        double push_y[COLUMNS] = {n ? 0 : u[1], 0, 0, 0, 0, 2 * w * y - 2 * vx, 0, -y, -x, 0, -vy, -vx};
        for (int j = 0; j < COLUMNS; j++) {
            b[0][j] = scale * a[1][j];
            b[1][j] = scale * (push_x[j] - kxx * a[0][j] - dxx * a[1][j] - kxy * a[2][j] + (2 * w - dxy) * a[3][j]);
            b[2][j] = scale * a[3][j];
            b[3][j] = scale * (push_y[j] - kxy * a[0][j] - (2 * w + dxy) * a[1][j] - kyy * a[2][j] - dyy * a[3][j]);
        }
        memcpy(a, b, sizeof a);
        for (int i = 0; i < S; i++)
            for (int j = 0; j < COLUMNS; j++)
                total[i][j] += b[i][j];
    }
}


static void flow(const double *c, double *s, const double *u, double h, long order, double g[S][N])
{
    double total[S][COLUMNS] = {{0}};
    for (int i = 0; i < S; i++) {
        total[i][0] = s[i];
        total[i][1 + i] = 1.0;
    }
    drift(c, u, h, order, total);
    for (int i = 0; i < S; i++) {
        s[i] = total[i][0];
        for (int j = 0; j < S; j++)
            g[i][j] = total[i][1 + j];
        for (int j = 0; j < K; j++)
            g[i][S + j] = active[j] < 2 ? 0.0 : total[i][3 + active[j]];
    }
}

static void propagate(double *p, double g[S][N], double factor)
{
    double t[S][N];
    for (int i = 0; i < S; i++) {
        for (int j = 0; j < N; j++)
            t[i][j] = 0.0;
        for (int k = 0; k < N; k++)
            for (int j = 0; j < N; j++)
                t[i][j] += g[i][k] * p[N * k + j];
    }
    for (int i = 0; i < S; i++)
        for (int j = i; j < S; j++) {
            double sum = 0.0;
            for (int k = 0; k < N; k++)
                sum += t[i][k] * g[j][k];
            p[N * i + j] = p[N * j + i] = factor * sum;
        }
    for (int i = 0; i < S; i++)
        for (int j = S; j < N; j++)
            p[N * i + j] = p[N * j + i] = factor * t[i][j];
    if (factor != 1.0)
        for (int i = S; i < N; i++)
            for (int j = S; j < N; j++)
                p[N * i + j] *= factor;
}

static void wander(const filter *f, double *p)
{
    double h = f->h;
    for (int axis = 0; axis < 2; axis++) {
        double q = f->force[axis];
        int i = 2 * axis;
        p[N * i + i] += q * h * h * h / 3.0;
        p[N * i + i + 1] += q * h * h / 2.0;
        p[N * (i + 1) + i] += q * h * h / 2.0;
        p[N * (i + 1) + i + 1] += q * h;
    }
    for (int k = 0; k < K; k++) {
        double q = f->intensity[k] * h, kick[S] = {0};
        int row = S + k;
        if (q == 0.0)
            continue;
        p[N * row + row] += q;
        if (active[k] == 2) { /* Euler's acceleration */
            kick[1] = f->x[2];
            kick[3] = -f->x[0];
        }
        for (int i = 0; i < S; i++) {
            p[N * row + i] += q * kick[i];
            p[N * i + row] += q * kick[i];
            for (int j = 0; j < S; j++)
                p[N * i + j] += q * kick[i] * kick[j];
        }
    }
}

/* A measurement h with P h, C h and their variances; returns the innovation squared over its variance. */
static double take(filter *f, const double *ph, const double *ch, double sp, double sc, double seen, double nu)
{
    double gain[N], rest[N], y[N], inverse = 1.0 / sp, root = sqrt(inverse), turn = 0.0;
    for (int i = 0; i < N; i++) {
        gain[i] = ph[i] * inverse;
        y[i] = ph[i] * root; /* P - y yT stays symmetric to the last bit, or fading would blow up what it is not */
    }
    for (int i = 0; i < S; i++)
        f->x[i] += gain[i] * nu;
    for (int i = 0; i < K; i++)
        f->x[S + active[i]] += gain[S + i] * nu;
    for (int i = 0; i < S; i++)
        turn -= f->gradient[i] * gain[i];
    f->variance += (sc * turn - 2.0 * seen) * turn;
    for (int i = 0; i < N; i++)
        f->cross[i] += (sc * turn - seen) * gain[i] - turn * ch[i];
    for (int i = 0; i < N; i++) /* Joseph: C - K wT - w KT */
        rest[i] = ch[i] - 0.5 * sc * gain[i];
    for (int i = 0; i < N; i++)
        for (int k = 0; k < N; k++) {
            f->p[N * i + k] -= y[i] * y[k];
            f->c[N * i + k] -= gain[i] * rest[k] + rest[i] * gain[k];
        }
    return nu * nu * inverse;
}

/* Row j, with axis >= 0 plus that axis's position. */
static double measure(filter *f, int axis, int j, double nu, double noise)
{
    double ph[N], ch[N], sp = noise, sc = noise, seen;
    for (int i = 0; i < N; i++) {
        ph[i] = j >= 0 ? f->p[N * j + i] : 0.0;
        ch[i] = j >= 0 ? f->c[N * j + i] : 0.0;
    }
    if (axis >= 0)
        for (int i = 0; i < N; i++) {
            ph[i] += f->p[N * 2 * axis + i];
            ch[i] += f->c[N * 2 * axis + i];
        }
    if (j >= 0) {
        sp += ph[j];
        sc += ch[j];
    }
    if (axis >= 0) {
        sp += ph[2 * axis];
        sc += ch[2 * axis];
    }
    seen = (j >= 0 ? f->cross[j] : 0.0) + (axis >= 0 ? f->cross[2 * axis] : 0.0);
    return take(f, ph, ch, sp, sc, seen, nu);
}

static int row_of(int constant)
{
    for (int k = 0; k < K; k++)
        if (active[k] == constant)
            return S + k;
    return -1;
}

void run(filter *f, const double *z, const double *u, long samples, double *angle, double *innovation)
{
    const int offset[2] = {row_of(0), row_of(1)}, rate_row = row_of(2);
    double energy, momentum, g[S][N], h = f->h;
    for (long m = 0; m < samples; m++, z += 2, u += 2, innovation += 2) {
        double moved[S] = {0}, factor = f->fade, virtual = u[0] != 0.0 || u[1] != 0.0 ? f->virtual_rate : 0.0;
        flow(f->x + S, f->x, u, h, f->order, g);
        f->variance += h * (2.0 * f->cross[rate_row] + h * f->c[N * rate_row + rate_row]);
        for (int i = 0; i < N; i++)
            f->cross[i] += h * f->c[N * rate_row + i];
        for (int i = 0; i < S; i++)
            for (int j = 0; j < N; j++)
                moved[i] += g[i][j] * f->cross[j];
        memcpy(f->cross, moved, sizeof moved);
        if (factor > 1.0 && f->nis > 3.0)
            factor *= 1.0 + fmin(0.01 * (f->nis - 3.0), 0.1);
        propagate(f->c, g, 1.0);
        propagate(f->p, g, factor);
        wander(f, f->c);
        wander(f, f->p);
        if (f->started)
            f->forced += nearest(pattern(f->x, f->rotation, f->rate, &energy, &momentum), f->theta) - f->theta
                + f->rate * h;
        {
            double *s = f->x, sine = 2.0 * (s[0] * s[2] + s[1] * s[3]);
            double cosine = s[0] * s[0] - s[2] * s[2] + s[1] * s[1] - s[3] * s[3];
            double square = sine * sine + cosine * cosine, share = square > 0.0 ? 1.0 / square : 0.0;
            f->gradient[0] = share * (cosine * s[2] - sine * s[0]);
            f->gradient[1] = share * (cosine * s[3] - sine * s[1]);
            f->gradient[2] = share * (cosine * s[0] + sine * s[2]);
            f->gradient[3] = share * (cosine * s[1] + sine * s[3]);
        }
        double nis = 0.0;
        for (int axis = 0; axis < 2; axis++)
            innovation[axis] = z[axis] - f->x[2 * axis] - f->x[S + axis];
        for (int axis = 0; axis < 2; axis++)
            nis += 0.5
                * measure(f, axis, offset[axis], z[axis] - f->x[2 * axis] - f->x[S + axis], f->noise[axis]);
        f->nis += (nis - f->nis) * 0.05;
        f->cursor = (f->cursor + 1) % K;
        if (f->prior[f->cursor] > 0.0)
            measure(f, -1, S + f->cursor, f->initial[f->cursor] - f->x[S + active[f->cursor]], f->prior[f->cursor]);
        for (int k = 0; k < K; k++) {
            double v = f->p[(N + 1) * (S + k)];
            if (f->spread[k] > 0.0 && v > f->spread[k])
                measure(f, -1, S + k, f->initial[k] - f->x[S + active[k]], v * f->spread[k] / (v - f->spread[k]));
        }
        f->time += h;
        double rate = f->x[S + 2], w = rate + virtual;
        double twice = pattern(f->x, w, rate, &energy, &momentum), plain = pattern(f->x, 0.0, 0.0, &energy, &momentum);
        f->rate_integral += rate * h;
        f->virtual_integral += virtual * h;
        if (!f->started) {
            f->started = 1;
            f->theta = f->theta_zero = 0.5 * twice;
            f->theta_plain = f->theta_plain_zero = nearest(plain, f->theta);
        } else {
            f->theta = nearest(twice, f->theta);
            f->theta_plain = nearest(plain, f->theta_plain);
        }
        f->rotation = w;
        f->rate = rate;
        if (!f->referred && f->time >= f->reference) {
            f->referred = 1;
            f->variance = 0.0;
            memset(f->cross, 0, sizeof f->cross);
        }
        angle[m] = f->theta_zero - f->theta + f->forced;
    }
}
