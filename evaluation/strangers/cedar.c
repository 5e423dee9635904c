/* A planar oscillator with hidden effects, its electronics, its control loop, and an observer that judges visibility.
 * Time in 1/omega0, length in the amplitude A, so that k = 1 is nominal. Each I_… is the place of a parameter in the array
 * p, defined by the lines that cedar.py puts in front. Sources of the laws: docs/reference/effects.md. */
#include <math.h>
#include <string.h>

enum { X, VX, Y, VY, LX, LY, HX, HY, PX, PVX, PY, PVY, Z0, Z1, NS };
#define P(name) (c->p[I_##name])
#define ON(a, b) (P(a) != 0.0 || P(b) != 0.0)

typedef struct {
    const double *p;
    double ux, uy;   /* force per mass of the drive, after its amplifier */
    double rx, ry;   /* drive as recorded */
    double fx, fy;   /* random force */
    double step;     /* step that served last */
    int n;           /* states in use */
} plant;

static double sq(double a) { return a * a; }

/* Rate of rotation at t, and its derivative. */
static double rate(const plant *c, double t, double *slope) {
    double phase = P(rate_omega) * t + P(rate_phase), w = P(rate_mean);
    *slope = 0.0;
    if (P(rate_sine) != 0.0) {
        w += P(rate_sine) * sin(phase);
        *slope += P(rate_sine) * P(rate_omega) * cos(phase);
    }
    if (P(rate_step) != 0.0) {
        double s = tanh((t - P(rate_at)) / P(rate_width));
        w += P(rate_step) * s;
        *slope += P(rate_step) * (1.0 - s * s) / P(rate_width);
    }
    return w;
}

/* Right side of the equations of motion and of all states with memory. */
static void rhs(const plant *c, double t, const double *s, double *d) {
    double x = s[X], y = s[Y], vx = s[VX], vy = s[VY], dw, w = rate(c, t, &dw);
    double r2 = x * x + y * y, v2 = vx * vx + vy * vy;
    double kxx = P(kxx), kyy = P(kyy), extra;
    if (P(self_heating_c) != 0.0) {
        kxx += P(self_heating_c) * s[Z0];
        kyy += P(self_heating_c) * s[Z0];
    }
    if (P(pump_c) != 0.0) {
        extra = P(pump_c) * cos(P(pump_omega) * t);
        kxx += extra;
        kyy += 0.5 * extra;
    }
    if (P(charge_step_c) != 0.0) kxx += P(charge_step_c) * 0.5 * (1.0 + tanh((t - P(charge_step_at)) / 20.0));
    double ax = -kxx * x - P(kxy) * y - P(dxx) * vx - P(dxy) * vy + c->ux + c->fx + 2.0 * w * vy + w * w * x + dw * y;
    double ay = -kyy * y - P(kxy) * x - P(dxy) * vx - P(dyy) * vy + c->uy + c->fy - 2.0 * w * vx + w * w * y - dw * x;
    /* springs */
    double cubic = P(cubic_isotropic_k3) * r2 + P(quintic_isotropic_k5r) * r2 * r2;
    ax -= x * (P(quadratic_stiffness_k2x) * x + P(cubic_stiffness_k3x) * x * x + P(quintic_stiffness_k5x) * sq(x * x));
    ay -= y * (P(quadratic_stiffness_k2y) * y + P(cubic_stiffness_k3y) * y * y + P(quintic_stiffness_k5y) * sq(y * y));
    ax -= cubic * x;
    ay -= cubic * y;
    ax -= P(nonreciprocal_stiffness_kn) * y;
    ay += P(nonreciprocal_stiffness_kn) * x;
    /* losses */
    double radial = P(nonlinear_damping_radial_d3r) * r2 + P(cubic_damping_radial_dcr) * v2;
    if (P(drag_radial_dqr) != 0.0) radial += P(drag_radial_dqr) * sqrt(v2 + 1e-4);
    if (P(dry_friction_radial_fr) != 0.0)
        radial += P(dry_friction_radial_fr) / sqrt(sq(P(dry_friction_radial_v0)) + v2);
    if (P(damping_patch_c) != 0.0) radial += P(damping_patch_c) * exp(-r2 / sq(P(damping_patch_width)));
    ax -= vx * (P(nonlinear_damping_d3x) * x * x + P(cubic_damping_dcx) * vx * vx + radial);
    ay -= vy * (P(nonlinear_damping_d3y) * y * y + P(cubic_damping_dcy) * vy * vy + radial);
    if (ON(damping_asymmetric_dax, damping_asymmetric_day) || ON(drag_dqx, drag_dqy)) {
        ax -= vx * tanh(100.0 * vx) * (P(damping_asymmetric_dax) + P(drag_dqx) * vx);
        ay -= vy * tanh(100.0 * vy) * (P(damping_asymmetric_day) + P(drag_dqy) * vy);
    }
    if (ON(dry_friction_fx, dry_friction_fy)) {
        ax -= P(dry_friction_fx) * tanh(vx / P(dry_friction_v0));
        ay -= P(dry_friction_fy) * tanh(vy / P(dry_friction_v0));
    }
    if (ON(dry_friction_asymmetric_fax, dry_friction_asymmetric_fay)) {
        ax -= P(dry_friction_asymmetric_fax) * sq(tanh(vx / P(dry_friction_asymmetric_v0)));
        ay -= P(dry_friction_asymmetric_fay) * sq(tanh(vy / P(dry_friction_asymmetric_v0)));
    }
    if (ON(stribeck_friction_stx, stribeck_friction_sty)) {
        double v0 = P(stribeck_friction_v0), vs = P(stribeck_friction_vs);
        ax -= P(stribeck_friction_stx) * tanh(vx / v0) * exp(-sq(vx / vs));
        ay -= P(stribeck_friction_sty) * tanh(vy / v0) * exp(-sq(vy / vs));
    }
    /* forces from outside, and those of no catalogue */
    if (P(base_vibration_omega) != 0.0) {
        double a = cos(P(base_vibration_omega) * t), b = sin(P(base_vibration_omega) * t);
        ax += P(base_vibration_bcx) * a + P(base_vibration_bsx) * b;
        ay += P(base_vibration_bcy) * a + P(base_vibration_bsy) * b;
    }
    if (P(stop_c) != 0.0 && x > P(stop_gap)) ax -= P(stop_c) * (x - P(stop_gap));
    if (P(lagged_drag_c) != 0.0) {
        ax -= P(lagged_drag_c) * s[Z0];
        ay -= P(lagged_drag_c) * s[Z1];
    }
    if (P(bristle_c) != 0.0) {
        ax -= P(bristle_c) * s[Z0];
        ay -= P(bristle_c) * s[Z1];
    }
    d[X] = vx; d[VX] = ax; d[Y] = vy; d[VY] = ay;
    if (c->n <= 4) return;
    for (int i = 4; i < NS; i++) d[i] = 0.0;
    if (P(sense_low_pass_tlx) > 0.0) d[LX] = (x - s[LX]) / P(sense_low_pass_tlx);
    if (P(sense_low_pass_tly) > 0.0) d[LY] = (y - s[LY]) / P(sense_low_pass_tly);
    d[HX] = x - P(sense_high_pass_hpx) * s[HX];
    d[HY] = y - P(sense_high_pass_hpy) * s[HY];
    double om = P(parasitic_mode_omega), ze = P(parasitic_mode_zeta);
    if (om > 0.0) {
        d[PX] = s[PVX]; d[PVX] = c->rx - 2.0 * ze * om * s[PVX] - om * om * s[PX];
        d[PY] = s[PVY]; d[PVY] = c->ry - 2.0 * ze * om * s[PVY] - om * om * s[PY];
    }
    if (P(self_heating_c) != 0.0) d[Z0] = (v2 + r2 - s[Z0]) / P(self_heating_tau);
    if (P(lagged_drag_c) != 0.0) {
        double v = sqrt(v2 + 1e-6);
        d[Z0] = (v * vx - s[Z0]) / P(lagged_drag_tau);
        d[Z1] = (v * vy - s[Z1]) / P(lagged_drag_tau);
    }
    if (P(bristle_c) != 0.0) {
        double v = sqrt(v2 + 1e-6) / P(bristle_reach);
        d[Z0] = vx - v * s[Z0];
        d[Z1] = vy - v * s[Z1];
    }
}

/* Right side alone, for a check by another integrator. */
void cedar_rhs(const double *p, int n, double t, const double *s, const double *force, double *d) {
    plant c = {p, force[0], force[1], force[0], force[1], 0.0, 0.0, 0.1, n};
    rhs(&c, t, s, d);
}

/* Gragg, Bulirsch and Stoer: midpoint rules of 2, 4, 6, 8 steps, extrapolated to order 8 (Hairer, Noersett & Wanner,
 * Solving ODEs I, II.9). Returns the difference between the last two orders. */
static double extrapolated(const plant *c, double t, double h, const double *s, double *out) {
    double table[4][NS], first[NS], a[NS], b[NS], d[NS], worst = 0.0;
    rhs(c, t, s, first);
    for (int j = 0; j < 4; j++) {
        int m = 2 * (j + 1);
        double g = h / m;
        for (int i = 0; i < c->n; i++) { a[i] = s[i]; b[i] = s[i] + g * first[i]; }
        for (int k = 1; k < m; k++) {
            rhs(c, t + k * g, b, d);
            for (int i = 0; i < c->n; i++) { double next = a[i] + 2.0 * g * d[i]; a[i] = b[i]; b[i] = next; }
        }
        rhs(c, t + h, b, d);
        for (int i = 0; i < c->n; i++) {
            table[j][i] = 0.5 * (a[i] + b[i] + g * d[i]);
        }
    }
    /* Aitken and Neville in h squared */
    for (int i = 0; i < c->n; i++) {
        double e[4] = {table[0][i], table[1][i], table[2][i], table[3][i]}, before = 0.0;
        for (int order = 1; order < 4; order++)
            for (int j = 3; j >= order; j--) {
                double ratio = (double)(j + 1) / (double)(j + 1 - order);
                if (j == 3) before = e[3];
                e[j] += (e[j] - e[j - 1]) / (ratio * ratio - 1.0);
            }
        out[i] = e[3];
        if (fabs(e[3] - before) > worst) worst = fabs(e[3] - before);
    }
    return worst;
}

/* From t over h, in steps as long as the tolerance permits. */
static void advance(plant *c, double t, double h, double *s) {
    double out[NS], done = 0.0;
    while (done < h) {
        double g = c->step < h - done ? c->step : h - done;
        double worst = extrapolated(c, t + done, g, s, out);
        if (worst > 2e-11 && g > 1e-5) { c->step = 0.5 * g; continue; }
        memcpy(s, out, sizeof(double) * (size_t)c->n);
        done = h - done - g < 1e-14 ? h : done + g;
        if (worst < 1e-13 && g >= c->step) c->step = c->step < 0.25 ? 2.0 * c->step : 0.5;
    }
}

void cedar_advance(const double *p, int n, double t, double h, double *s, const double *force) {
    plant c = {p, force[0], force[1], force[0], force[1], 0.0, 0.0, 0.1, n};
    advance(&c, t, h, s);
}

static double over(double u, double limit) { return u > limit ? limit - u : u < -limit ? -limit - u : 0.0; }
static double within(double u, double band) { return u + over(u, band); }

/* Drive amplifier and forcer: what the recorded drive becomes as force. */
static void drive(plant *c, double ux, double uy) {
    double sx = 1.0 + P(drive_gain_hx), sy = 1.0 + P(drive_gain_hy);
    c->ux = sx * ux + P(drive_misalignment_mx) * uy + (P(electrostatic_drive_qx) + P(soft_amplifier_c) * ux) * ux * ux;
    c->uy = sy * uy + P(drive_misalignment_my) * ux + (P(electrostatic_drive_qy) + P(soft_amplifier_c) * uy) * uy * uy;
    if (P(drive_saturation_limit) > 0.0) {
        c->ux += P(drive_saturation_sx) * over(ux, P(drive_saturation_limit));
        c->uy += P(drive_saturation_sy) * over(uy, P(drive_saturation_limit));
    }
    if (P(drive_dead_band_band) > 0.0) {
        c->ux -= P(drive_dead_band_zx) * within(ux, P(drive_dead_band_band));
        c->uy -= P(drive_dead_band_zy) * within(uy, P(drive_dead_band_band));
    }
}

/* What the two channels show, in units of A, before noise. bx, by: positions, late where the channel is. */
static void sense(const plant *c, double t, const double *s, double bx, double by, double *v) {
    double x = P(sense_low_pass_tlx) > 0.0 ? s[LX] : bx, y = P(sense_low_pass_tly) > 0.0 ? s[LY] : by;
    v[0] = P(phi_x) + x + P(sense_cross_coupling_ex) * by + P(sense_quadratic_a2x) * bx * bx
           + P(sense_cubic_a3x) * bx * bx * bx + P(drive_feedthrough_fdx) * c->rx + P(parasitic_mode_rx) * s[PX] 
           - P(sense_high_pass_hpx) * s[HX];
    v[1] = P(phi_y) + y + P(sense_gain_gy) * by + P(sense_cross_coupling_ey) * bx + P(sense_quadratic_a2y) * by * by
           + P(sense_cubic_a3y) * by * by * by + P(drive_feedthrough_fdy) * c->ry + P(parasitic_mode_ry) * s[PY]
           - P(sense_high_pass_hpy) * s[HY];
    if (P(gain_flutter_c) != 0.0) v[1] += P(gain_flutter_c) * sin(P(gain_flutter_omega) * t) * by;
    if (P(interference_omega) > 0.0) {
        double a = cos(P(interference_omega) * t), b = sin(P(interference_omega) * t);
        v[0] += P(interference_lcx) * a + P(interference_lsx) * b;
        v[1] += P(interference_lcy) * a + P(interference_lsy) * b;
    }
    if (P(sense_clipping_level) > 0.0) {
        v[0] += P(sense_clipping_clx) * over(P(phi_x) + bx, P(sense_clipping_level));
        v[1] += P(sense_clipping_cly) * over(P(phi_y) + by, P(sense_clipping_level));
    }
}

static double rounded(double a, double lsb, double full) {
    double code = nearbyint(a / lsb) * lsb;
    return code > full ? full : code < -full ? -full : code;
}

/* Runs warm + n samples from the state s, keeps the last n: v [n][2] in A, u [n][2] in A omega0², start the state at the
 * first of them. noise [warm + n][6] of unit variance: sense x, y; force x, y; dither x, y. */
void cedar_run(const double *p, int states, int warm, int n, int latency, double *s, const double *noise, double *v,
               double *u, double *start) {
    plant plant_ = {p, 0, 0, 0, 0, 0, 0, 0.1, states}, *c = &plant_;
    double h = P(h), past[2][2] = {{0, 0}, {0, 0}}, queue[8][2], w[2], offset[2] = {P(phi_x), P(phi_y)};
    double zr[2] = {s[X], s[Y]}, zi[2] = {s[VX], s[VY]};
    memset(queue, 0, sizeof queue);
    double turn = h * P(loop_omega), cs = cos(turn), sn = sin(turn);
    double ahead = turn * (latency + 0.5), ca = cos(ahead), sa = sin(ahead);
    for (int m = 0; m < warm + n; m++) {
        const double *e = noise + 6 * m;
        double t0 = (m - warm - 1) * h, t = t0 + h, at = 0.0, bx = 0.0, by = 0.0;
        memcpy(past[0], past[1], sizeof past[0]);
        memcpy(past[1], queue[m % 8], sizeof past[1]);
        c->rx = past[1][0]; c->ry = past[1][1];
        c->fx = P(force_sd) * e[2]; c->fy = P(force_sd) * e[3];
        /* the interval in pieces: the late drives change, the late channels sample */
        double tux = P(drive_delay_tux), tuy = P(drive_delay_tuy);
        double sx = h - P(sense_delay_tsx), sy = h - P(sense_delay_tsy);
        double ends[5] = {tux, tuy, sx, sy, h};
        for (int a = 0; a < 5; a++)
            for (int b = a + 1; b < 5; b++)
                if (ends[b] < ends[a]) { double swap = ends[a]; ends[a] = ends[b]; ends[b] = swap; }
        for (int k = 0; k < 5; k++) {
            if (ends[k] > at) {
                double mid = 0.5 * (at + ends[k]);
                drive(c, past[mid > tux][0], past[mid > tuy][1]);
                advance(c, t0 + at, ends[k] - at, s);
                at = ends[k];
            }
            if (at == sx) bx = s[X];
            if (at == sy) by = s[Y];
        }
        sense(c, t, s, bx, by, w);
        for (int a = 0; a < 2; a++) w[a] = rounded(w[a] + P(noise_sd) * e[a], P(adc_lsb), P(adc_full));
        if (m == warm) memcpy(start, s, sizeof(double) * 4);
        if (m >= warm) {
            memcpy(v + 2 * (m - warm), w, sizeof w);
            memcpy(u + 2 * (m - warm), past[1], sizeof past[1]);
        }
        /* the loop: a resonator follows each channel, its phasor is turned ahead by the latency and half a hold */
        double q[2], r[2], to[2];
        for (int a = 0; a < 2; a++) {
            double re = zr[a] * cs + zi[a] * sn, im = zi[a] * cs - zr[a] * sn, error = w[a] - offset[a] - re;
            zr[a] = re + P(loop_gain) * error;
            zi[a] = im;
            offset[a] += 0.05 * P(loop_gain) * error;
            q[a] = zr[a] * ca + zi[a] * sa;
            r[a] = zi[a] * ca - zr[a] * sa;
        }
        double held = 1.0 + P(loop_modulation) * sin(P(loop_modulation_omega) * t), e0 = 0.5 * held * held;
        double energy = 0.5 * (q[0] * q[0] + q[1] * q[1] + r[0] * r[0] + r[1] * r[1]);
        double across = P(loop_quadrature) * (q[0] * r[1] - q[1] * r[0]) / e0;
        double push = P(loop_damping) - P(loop_energy) * (energy / e0 - 1.0);
        double turned = 2.0 * P(loop_virtual);
        to[0] = P(loop_kd) * q[0] + P(loop_kxy) * q[1] + push * r[0] + across * q[1] + turned * r[1];
        to[1] = -P(loop_kd) * q[1] + P(loop_kxy) * q[0] + push * r[1] - across * q[0] - turned * r[0];
        for (int a = 0; a < 2; a++)
            queue[(m + 1 + latency) % 8][a] = rounded(to[a] + P(loop_dither) * e[4 + a], P(dac_lsb), P(dac_full));
    }
}

/* exp(A h) and its integral times the columns of the two forces, by the series. */
static void flow(double A[4][4], double h, double F[4][4], double G[4][2]) {
    double term[4][4], next[4][4];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            term[i][j] = F[i][j] = i == j;
            if (j < 2) G[i][j] = i == 2 * j + 1 ? h : 0.0;
        }
    for (int k = 1; k < 13; k++) {
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                double sum = 0.0;
                for (int l = 0; l < 4; l++) sum += A[i][l] * term[l][j];
                next[i][j] = sum * h / k;
            }
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 4; j++) {
                term[i][j] = next[i][j];
                F[i][j] += next[i][j];
                if (j < 2) G[i][j] += next[i][2 * j + 1] * h / (k + 1);
            }
    }
}

/* Forces that one of each parameter adds: rate, kxx, kyy, kxy, dxx, dyy, dxy. */
static void partial(const double *s, double b[7][2]) {
    double of[7][2] = {{2 * s[VY], -2 * s[VX]}, {-s[X], 0}, {0, -s[Y]}, {-s[Y], -s[X]},
                       {-s[VX], 0}, {0, -s[VY]}, {-s[VY], -s[VX]}};
    memcpy(b, of, sizeof of);
}

#define M 13
/* Extended Kalman filter of the model without effects (x, vx, y, vy, two offsets, rate, six parameters) over n samples.
 * Returns rms of the innovation over its expected deviation in the second half; e: initial estimate of variances var. */
double cedar_judge(int n, double h, const double *v, const double *u, double *e, const double *var, double noise,
                   double force, double walk) {
    double C[M][M], G[4][M], R[4][M], F[4][4], B[4][2], Fm[4][4], Bm[4][2], sum = 0.0;
    memset(C, 0, sizeof C);
    for (int i = 0; i < M; i++) C[i][i] = var[i];
    for (int m = 0; m < n; m++) {
        if (m > 0) {
            double w = e[6], A[4][4] = {{0, 1, 0, 0}, {w * w - e[7], -e[10], -e[9], 2 * w - e[12]},
                                        {0, 0, 0, 1}, {-e[9], -2 * w - e[12], w * w - e[8], -e[11]}};
            double mid[4], end[4], b0[7][2], b1[7][2], b2[7][2];
            const double *um = u + 2 * m;
            flow(A, h, F, B);
            flow(A, 0.5 * h, Fm, Bm);
            for (int i = 0; i < 4; i++) {
                mid[i] = Bm[i][0] * um[0] + Bm[i][1] * um[1];
                end[i] = B[i][0] * um[0] + B[i][1] * um[1];
                for (int j = 0; j < 4; j++) { mid[i] += Fm[i][j] * e[j]; end[i] += F[i][j] * e[j]; }
            }
            partial(e, b0); partial(mid, b1); partial(end, b2);
            for (int i = 0; i < 4; i++) {
                for (int j = 0; j < 4; j++) G[i][j] = F[i][j];
                G[i][4] = G[i][5] = 0.0;
                for (int j = 0; j < 7; j++) {
                    double last = i == VX ? b2[j][0] : i == VY ? b2[j][1] : 0.0;
                    double first = F[i][VX] * b0[j][0] + F[i][VY] * b0[j][1];
                    double middle = Fm[i][VX] * b1[j][0] + Fm[i][VY] * b1[j][1];
                    G[i][6 + j] = h / 6 * (first + 4 * middle + last);   /* Simpson's rule */
                }
            }
            memcpy(e, end, sizeof end);
            for (int i = 0; i < 4; i++)
                for (int j = 0; j < M; j++) {
                    R[i][j] = 0.0;
                    for (int l = 0; l < M; l++) R[i][j] += G[i][l] * C[l][j];
                }
            for (int i = 0; i < 4; i++)
                for (int j = 0; j < M; j++) {
                    double sum_ = R[i][j];
                    if (j < 4) {
                        sum_ = force * (B[i][0] * B[j][0] + B[i][1] * B[j][1]);
                        for (int l = 0; l < M; l++) sum_ += R[i][l] * G[j][l];
                    }
                    C[i][j] = sum_;
                    C[j][i] = sum_;
                }
            C[6][6] += walk;
        }
        for (int a = 0; a < 2; a++) {
            int q = 2 * a, o = 4 + a;
            double S = C[q][q] + 2 * C[q][o] + C[o][o] + noise, nu = v[2 * m + a] - e[q] - e[o], K[M];
            if (2 * m >= n) sum += nu * nu / S;
            for (int i = 0; i < M; i++) K[i] = (C[i][q] + C[i][o]) / S;
            for (int i = 0; i < M; i++) {
                e[i] += K[i] * nu;
                for (int j = i; j < M; j++) C[i][j] = C[j][i] = C[i][j] - K[i] * K[j] * S;
            }
        }
    }
    return sqrt(sum / (2.0 * (n - n / 2)));
}
