/* A mass in the plane with its sense chain, drive chain and control loop: the inner loop of birch.py, which compiles it.
   Numbers are SI, forces per unit mass. P(name) is a parameter by its name; birch.py writes their list before this text. */
#include <math.h>
#include <string.h>

#define P(name) (c->p[I_##name])
#define COLUMNS 5 /* of the extrapolation: modified midpoint rules with 2, 4, 6, 8, 10 steps, order 10 */
#define DEEPEST 26

/* x, x', y, y'; low-pass x, y; leaking integrals of x, y; parasitic mode p, p' of x and of y; heat of the motion;
   wake of x, y; mean square of the drive */
enum { X, VX, Y, VY, LX, LY, HX, HY, PX, QX, PY, QY, HEAT, WX, WY, SAG, NS };

typedef struct {
    const double *p;
    int ns;                                       /* states that are in use */
    int elastic, lossy, timed, chain;             /* kinds of laws that are in use */
    double act_x, act_y, ux, uy, noise_x, noise_y; /* drive that acts, drive as recorded, force noise */
    double scale[NS];
} Context;

static int any(const Context *c, int first, int last)
{
    for (int i = first; i <= last; i++)
        if (c->p[i] != 0) return 1;
    return 0;
}

/* 0 to 1 with continuous first and second derivative (a turntable that is told to change its rate) */
static double ramp(double s, double *slope)
{
    if (s <= 0 || s >= 1) { *slope = 0; return s >= 1; }
    *slope = 30 * s * s * (1 - s) * (1 - s);
    return s * s * s * (10 + s * (6 * s - 15));
}

static double turntable(const Context *c, double t, double *change)
{
    double rate = P(rate) + P(rate_amp) * sin(P(rate_w) * t + P(rate_phase)), slope;
    *change = P(rate_amp) * P(rate_w) * cos(P(rate_w) * t + P(rate_phase));
    for (int i = 0; i < 4; i++) {
        const double *step = c->p + I_step0_t + 3 * i; /* begin, duration, size */
        if (step[2] == 0) continue;
        rate += step[2] * ramp((t - step[0]) / step[1], &slope);
        *change += step[2] * slope / step[1];
    }
    return rate;
}

static double warmth(const Context *c, double t)
{
    return P(warm_ramp) * t + P(warm_amp) * sin(P(warm_w) * t);
}

void birch_rhs(const Context *c, double t, const double *s, double *d)
{
    const double x = s[X], v = s[VX], y = s[Y], w = s[VY];
    double change, rate = turntable(c, t, &change);
    const double supply = 1 - P(sag_a) * (c->chain ? s[SAG] : 0);
    double fx = supply * c->act_x + c->noise_x, fy = supply * c->act_y + c->noise_y;
    fx += 2 * rate * w + rate * rate * x + change * y - P(kxx) * x - P(kxy) * y - P(dxx) * v - P(dxy) * w;
    fy += -2 * rate * v + rate * rate * y - change * x - P(kxy) * x - P(kyy) * y - P(dxy) * v - P(dyy) * w;
    if (c->elastic) {
        double rr = x * x + y * y, r = sqrt(rr);
        fx += -P(k3x) * x * x * x - P(k3) * rr * x - P(k2x) * x * x - P(kn) * y;
        fy += -P(k3y) * y * y * y - P(k3) * rr * y - P(k2y) * y * y + P(kn) * x;
        if (P(stop_k) != 0 && r > P(stop_gap)) { /* Hertz contact with a round stop */
            double push = P(stop_k) * pow(r - P(stop_gap), 1.5) / r;
            fx -= push * x;
            fy -= push * y;
        }
    }
    if (c->lossy) {
        double vv = v * v + w * w, speed = sqrt(vv), hard = P(v0) > 0 ? P(v0) : 1;
        double tx = P(v0) > 0 ? tanh(v / hard) : 0, ty = P(v0) > 0 ? tanh(w / hard) : 0;
        fx -= P(d3x) * v * x * x + P(fx) * tx + P(fax) * tx * tx + P(dax) * fabs(v) + P(dqx) * v * fabs(v)
              + P(dcx) * v * v * v + (P(d3r) * (x * x + y * y) + P(dqr) * speed + P(dcr) * vv) * v;
        fy -= P(d3y) * w * y * y + P(fy) * ty + P(fay) * ty * ty + P(day) * fabs(w) + P(dqy) * w * fabs(w)
              + P(dcy) * w * w * w + (P(d3r) * (x * x + y * y) + P(dqr) * speed + P(dcr) * vv) * w;
    }
    if (c->timed) {
        double warm = warmth(c, t), shake = P(base_w) * t, pump = P(pump_k) * cos(P(pump_w) * t);
        double trap = P(trap_k) * tanh(8 * (sin(P(trap_w) * t) + sin(1.618 * P(trap_w) * t + 1)));
        fx += P(bcx) * cos(shake) + P(bsx) * sin(shake) - warm * (P(ktx) * x + P(ktxy) * y + P(dtx) * v + P(dtxy) * w);
        fy += P(bcy) * cos(shake) + P(bsy) * sin(shake) - warm * (P(ktxy) * x + P(kty) * y + P(dtxy) * v + P(dty) * w);
        fx -= (pump + trap) * x;
        fy -= pump * y;
    }
    if (c->chain) {
        double speed = sqrt(v * v + w * w), w2 = P(mode_w) * P(mode_w), zw = 2 * P(mode_zeta) * P(mode_w);
        fx += P(heat_k) * s[HEAT] * x - P(wake_c) * s[WX];
        fy += P(heat_k) * s[HEAT] * y - P(wake_c) * s[WY];
        d[LX] = P(tlx) > 0 ? (x - s[LX]) / P(tlx) : v;
        d[LY] = P(tly) > 0 ? (y - s[LY]) / P(tly) : w;
        d[HX] = x - P(hpx) * s[HX];
        d[HY] = y - P(hpy) * s[HY];
        d[PX] = s[QX];
        d[QX] = c->ux - zw * s[QX] - w2 * s[PX];
        d[PY] = s[QY];
        d[QY] = c->uy - zw * s[QY] - w2 * s[PY];
        d[HEAT] = ((v * v + w * w) / P(heat_vv) - s[HEAT]) / P(heat_tau);
        d[WX] = (v * speed - s[WX]) / P(wake_tau);
        d[WY] = (w * speed - s[WY]) / P(wake_tau);
        d[SAG] = ((c->ux * c->ux + c->uy * c->uy) / P(sag_uu) - s[SAG]) / P(sag_tau);
    }
    d[X] = v;
    d[VX] = fx;
    d[Y] = w;
    d[VY] = fy;
}

/* One step of Gragg's extrapolated midpoint rule (Hairer, Norsett & Wanner I, II.9), halved where its last two columns
   differ by more than 1e-11 of the states' scales. */
static void advance(const Context *c, double t, double h, double *s, int depth)
{
    static const int steps[COLUMNS] = {2, 4, 6, 8, 10};
    double table[COLUMNS][NS], start[NS], slope[NS], before[NS], now[NS], next[NS], error = 0;
    const int ns = c->ns;
    if (h <= 0) return;
    birch_rhs(c, t, s, start);
    for (int k = 0; k < COLUMNS; k++) {
        const int n = steps[k];
        const double hn = h / n;
        for (int i = 0; i < ns; i++) { before[i] = s[i]; now[i] = s[i] + hn * start[i]; }
        for (int m = 1; m < n; m++) {
            birch_rhs(c, t + m * hn, now, slope);
            for (int i = 0; i < ns; i++) { next[i] = before[i] + 2 * hn * slope[i]; before[i] = now[i]; now[i] = next[i]; }
        }
        birch_rhs(c, t + h, now, slope);
        for (int i = 0; i < ns; i++) next[i] = 0.5 * (before[i] + now[i] + hn * slope[i]);
        for (int j = 0; j < k; j++) { /* Aitken and Neville; table[j] holds the column of the row before */
            const double q = (double)n / steps[k - 1 - j], weight = 1 / (q * q - 1);
            for (int i = 0; i < ns; i++) {
                const double better = next[i] + (next[i] - table[j][i]) * weight;
                if (k == COLUMNS - 1 && j == k - 1) error = fmax(error, fabs(better - next[i]) / c->scale[i]);
                table[j][i] = next[i];
                next[i] = better;
            }
        }
        memcpy(table[k], next, sizeof next);
    }
    if (error > 1e-11 && depth < DEEPEST) {
        advance(c, t, h / 2, s, depth + 1);
        advance(c, t + h / 2, h / 2, s, depth + 1);
    } else {
        memcpy(s, next, ns * sizeof *s);
    }
}

static double clip(double value, double limit) { return value > limit ? limit : value < -limit ? -limit : value; }

/* What the drive amplifier makes of its input. */
static void amplifier(const Context *c, double ux, double uy, double *ax, double *ay)
{
    *ax = ux + P(hx) * ux + P(mx) * uy + P(qx) * ux * ux;
    *ay = uy + P(hy) * uy + P(my) * ux + P(qy) * uy * uy;
    if (P(limit) > 0) { *ax += P(sx) * (clip(ux, P(limit)) - ux); *ay += P(sy) * (clip(uy, P(limit)) - uy); }
    if (P(band) > 0) { *ax -= P(zx) * clip(ux, P(band)); *ay -= P(zy) * clip(uy, P(band)); }
}

/* What the sense chain makes of the displacements q (as they were ts ago) at time t, in V, without noise. */
static void sensor(const Context *c, double t, const double *q, const double *s, double *volts)
{
    double x = q[0], y = q[1], warm = warmth(c, t), line = P(line_w) * t;
    if (P(tlx) > 0) x = s[LX];
    if (P(tly) > 0) y = s[LY];
    x -= P(hpx) * s[HX];
    y -= P(hpy) * s[HY];
    double a = x + P(ex) * y + P(a2x) * x * x + P(a3x) * x * x * x + P(fdx) * c->ux + P(rx) * s[PX];
    double b = y + P(ey) * x + P(a2y) * y * y + P(a3y) * y * y * y + P(fdy) * c->uy + P(ry) * s[PY];
    a += P(lcx) * cos(line) + P(lsx) * sin(line) + P(ptx) * warm;
    b += P(lcy) * cos(line) + P(lsy) * sin(line) + P(pty) * warm + P(gy) * y;
    if (P(aging_g) != 0) b += P(aging_g) * (1 - exp(-t / P(aging_tau))) * y;
    if (P(cross_c) != 0) { a -= P(cross_c) * tanh(x / P(cross_w)); b -= P(cross_c) * tanh(y / P(cross_w)); }
    a += P(phi_x);
    b += P(phi_y);
    if (P(level) > 0) { a += P(clx) * (clip(a, P(level)) - a); b += P(cly) * (clip(b, P(level)) - b); }
    if (P(inl_a) != 0) { a += P(inl_a) * sin(P(inl_w) * a); b += P(inl_a) * sin(P(inl_w) * b); }
    volts[0] = P(gain_x) * a;
    volts[1] = P(gain_y) * b;
}

/* The laboratory's loop: each channel through a complex resonator at the nominal frequency; from its output energy,
   quadrature and the force of the next interval, turned ahead over latency and hold. */
typedef struct { double zx[2], zy[2], sum; } Loop;

static void track(const Context *c, double sensed, double *z)
{
    const double keep = 1 - P(loop_beta), angle = P(loop_w) * P(ts), re = keep * z[0], im = keep * z[1];
    z[0] = re * cos(angle) - im * sin(angle) + 2 * P(loop_beta) * sensed;
    z[1] = re * sin(angle) + im * cos(angle);
}

static void command(const Context *c, Loop *loop, double t, const double *volts, double *u)
{
    const double w = P(loop_w), ahead = w * (P(latency) + 0.5) * P(ts), ca = cos(ahead), sa = sin(ahead);
    track(c, volts[0] / P(gain_x), loop->zx);
    track(c, volts[1] / P(gain_y), loop->zy);
    const double *a = loop->zx, *b = loop->zy;
    const double energy = a[0] * a[0] + a[1] * a[1] + b[0] * b[0] + b[1] * b[1];
    const double quadrature = (a[1] * b[0] - a[0] * b[1]) / fmax(energy, 1e-12 * P(amp) * P(amp)); /* (x y' - y x')/wE */
    const double wave = sin(P(mod_w) * t);
    const double target = P(amp) * (1 + P(mod) * (P(mod_square) != 0 ? (wave > 0 ? 1 : -1) : wave));
    const double error = clip(1 - energy / (target * target), 1);
    loop->sum = clip(loop->sum + P(loop_i) * error, P(loop_max));
    const double push = clip(P(loop_e) * error + loop->sum, P(loop_max)) * w;
    const double x = a[0] * ca - a[1] * sa, y = b[0] * ca - b[1] * sa;
    const double v = -w * (a[0] * sa + a[1] * ca), vy = -w * (b[0] * sa + b[1] * ca);
    const double turn = 2 * P(loop_q) * w * w * quadrature;
    u[0] = push * v + turn * y + 2 * P(virtual) * vy;
    u[1] = push * vy - turn * x - 2 * P(virtual) * v;
}

static double code(double value, double step) { return step > 0 ? step * rint(value / step) : value; }

/* n rows from time t0 on. disturb: n rows of force noise x, y, noise of the reading x, y (V), dither x, y. With feedback
   the loop makes u, else it is read. states, where given, gets all NS states of each row. 0, or 1 + the row at which the
   motion left all bounds. */
long birch_run(const double *p, long n, double t0, const double *disturb, int feedback, double *state, double *u,
               double *volts, double *states)
{
    Context context = {.p = p, .ns = 4}, *c = &context;
    Loop loop = {.sum = 0};
    double queue[8][2] = {{0}}, last_x = 0, last_y = 0, q[2] = {state[X], state[Y]};
    c->elastic = any(c, I_k3x, I_stop_gap);
    c->lossy = any(c, I_d3x, I_v0);
    c->timed = any(c, I_bcx, I_trap_w);
    c->chain = any(c, I_tlx, I_sag_a);
    if (c->chain) c->ns = NS;
    for (int i = 0; i < NS; i++) c->scale[i] = 1;
    const double length = P(amp), w = sqrt(P(kxx)), ts = P(ts);
    const double scale[NS] = {length, length * w, length, length * w, length, length, length / w, length / w, length,
                              length * w, length, length * w, 1, length * length * w * w, length * length * w * w, 1};
    memcpy(c->scale, scale, sizeof scale);
    loop.zx[0] = state[X], loop.zx[1] = -state[VX] / w;
    loop.zy[0] = state[Y], loop.zy[1] = -state[VY] / w;
    for (long m = 0; m < n; m++) {
        const double *noise = disturb ? disturb + 6 * m : 0, end = t0 + m * ts;
        if (m > 0) {
            const double begin = end - ts;
            double now_x, now_y;
            c->noise_x = noise ? noise[0] : 0;
            c->noise_y = noise ? noise[1] : 0;
            if (feedback) memcpy(u + 2 * m, queue[m % 8], sizeof queue[0]);
            c->ux = u[2 * m];
            c->uy = u[2 * m + 1];
            amplifier(c, c->ux, c->uy, &now_x, &now_y);
            /* the interval is cut where a late drive comes in and where a late reading was taken */
            double cuts[5] = {P(tux), P(tuy), ts - P(tsx), ts - P(tsy), ts}, at = 0;
            c->act_x = P(tux) > 0 ? last_x : now_x;
            c->act_y = P(tuy) > 0 ? last_y : now_y;
            while (at < ts) {
                double to = ts;
                for (int i = 0; i < 4; i++)
                    if (cuts[i] > at && cuts[i] < to) to = cuts[i];
                advance(c, begin + at, to - at, state, 0);
                at = to;
                if (at >= P(tux)) c->act_x = now_x;
                if (at >= P(tuy)) c->act_y = now_y;
                if (at == cuts[2]) q[0] = state[X];
                if (at == cuts[3]) q[1] = state[Y];
            }
            last_x = now_x;
            last_y = now_y;
        } else if (feedback) {
            u[0] = u[1] = 0;
        }
        sensor(c, end, q, state, volts + 2 * m);
        for (int i = 0; i < 2; i++) volts[2 * m + i] = code(volts[2 * m + i] + (noise ? noise[2 + i] : 0), P(adc));
        if (states) memcpy(states + NS * m, state, NS * sizeof *state);
        if (!(fabs(state[X]) < 10 * length && fabs(state[Y]) < 10 * length)) return 1 + m;
        if (feedback) {
            double *force = queue[(m + 1 + (long)P(latency)) % 8];
            command(c, &loop, end, volts + 2 * m, force);
            for (int i = 0; i < 2; i++) {
                const double most = P(dac) > 0 ? P(dac) * floor(P(full_scale) / P(dac)) : P(full_scale);
                force[i] = clip(code(force[i] + (noise ? noise[4 + i] : 0), P(dac)), most);
            }
        }
    }
    return 0;
}

/* For a check with another integrator: the law at a state, with a drive that acts as it is given. */
void birch_law(const double *p, double t, double ux, double uy, const double *s, double *d)
{
    Context context = {.p = p, .ns = NS, .elastic = 1, .lossy = 1, .timed = 1, .chain = 1};
    context.ux = ux, context.uy = uy;
    amplifier(&context, ux, uy, &context.act_x, &context.act_y);
    birch_rhs(&context, t, s, d);
}
