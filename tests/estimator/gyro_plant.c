/* The plant of gyro_loop.py: equation (2) by Runge and Kutta. Shares no line with the core. */
enum { SUBSTEPS = 16 };

static void slope_of(const double *s, const double *p, const double *u, double rate, double change, double *out)
{
    out[0] = s[1];
    out[1] = u[0] - p[3] * s[1] - p[5] * s[3] - p[0] * s[0] - p[2] * s[2];
    out[1] += 2 * rate * s[3] + rate * rate * s[0] + change * s[2];
    out[2] = s[3];
    out[3] = u[1] - p[5] * s[1] - p[4] * s[3] - p[2] * s[0] - p[1] * s[2];
    out[3] += -2 * rate * s[1] + rate * rate * s[2] - change * s[0];
}

/* Move s (4,) over one sample; p = (kxx, kyy, kxy, dxx, dyy, dxy); force u (2,) held, rate linear in time. */
__attribute__((visibility("default"))) void swing(double *s, const double *p, const double *u, double rate_from,
                                                  double rate_to, double h)
{
    static const double ahead[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    double dt = h / SUBSTEPS, change = (rate_to - rate_from) / h;
    for (int n = 0; n < SUBSTEPS; n++) {
        double rate = rate_from + change * n * dt, k[4] = {0.0}, there[4], moved[4] = {0.0};
        for (int stage = 0; stage < 4; stage++) {
            for (int i = 0; i < 4; i++)
                there[i] = s[i] + ahead[stage] * dt * k[i];
            slope_of(there, p, u, rate + ahead[stage] * change * dt, change, k);
            for (int i = 0; i < 4; i++)
                moved[i] += weight[stage] * k[i];
        }
        for (int i = 0; i < 4; i++)
            s[i] += dt / 6 * moved[i];
    }
}
