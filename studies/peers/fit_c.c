/* Levenberg-Marquardt on (viscous friction, Coulomb friction, discharge coefficient) from a position record.
 *
 * One pass over the record simulates four parameter sets in the lanes of one vector: the base and one perturbed
 * set for each free parameter. That costs what one run costs and gives cost, gradient and Hessian at once, so a
 * trial step that is accepted needs no second pass.
 */
#define LANES 4
#include "axis.h"
#include <string.h>

enum { FREE = 3 };
static const int which[FREE] = {VISCOUS_FRICTION, COULOMB_FRICTION, DISCHARGE_COEFFICIENT};

typedef struct { double cost, H[FREE][FREE], g[FREE]; } Normal;

/* Sum of squares of y - x with its gradient and Gauss-Newton Hessian in theta = p / scale. */
static Normal pass(const double *p, const double *theta, const double *scale, const double *x0, const double *u,
                   const double *y, int n, double dt, int steps)
{
    const double delta = 1e-6;
    double set[LANES][PARAMETERS];
    const double *sets[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        memcpy(set[lane], p, sizeof set[lane]);
        for (int i = 0; i < FREE; i++) set[lane][which[i]] = (theta[i] + (lane == i + 1 ? delta : 0)) * scale[i];
        sets[lane] = set[lane];
    }
    Axis m;
    prepare(&m, sets);
    State s = start_state(x0);
    Normal out = {0};
    double H[6] = {0};
    for (int k = 0; k < n; k++) {
        double base = s.x[0], r = y[k] - base;
        double a = s.x[1] - base, b = s.x[2] - base, c = s.x[3] - base;
        out.cost += r * r;
        out.g[0] += a * r, out.g[1] += b * r, out.g[2] += c * r;
        H[0] += a * a, H[1] += a * b, H[2] += a * c, H[3] += b * b, H[4] += b * c, H[5] += c * c;
        s = hold(&m, s, u[k], steps, dt / steps);
    }
    const int at[FREE][FREE] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    for (int i = 0; i < FREE; i++) {
        out.g[i] /= delta;
        for (int j = 0; j < FREE; j++) out.H[i][j] = H[at[i][j]] / (delta * delta);
    }
    return out;
}

/* Solve (H + damping diag H) d = g by Cholesky; returns 0 if H is not positive definite. */
static int damped_step(const Normal *q, double damping, double *d)
{
    double L[FREE][FREE];
    for (int i = 0; i < FREE; i++)
        for (int j = 0; j <= i; j++) {
            double sum = q->H[i][j] * (i == j ? 1 + damping : 1);
            for (int k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
            if (i == j && !(sum > 0)) return 0;
            L[i][j] = i == j ? sqrt(sum) : sum / L[j][j];
        }
    for (int i = 0; i < FREE; i++) {
        d[i] = q->g[i];
        for (int k = 0; k < i; k++) d[i] -= L[i][k] * d[k];
        d[i] /= L[i][i];
    }
    for (int i = FREE - 1; i >= 0; i--) {
        for (int k = i + 1; k < FREE; k++) d[i] -= L[k][i] * d[k];
        d[i] /= L[i][i];
    }
    return 1;
}

/* Fit in place: p holds all parameters, its three free ones as start values and then as results.
 * Converged when the next step would lower the sum of squares by less than `tolerance` of itself; that step is
 * still taken. Returns the number of passes, negative if `most` were not enough. */
int fit(double *p, const double *x0, const double *u, const double *y, int n, double dt, int steps,
        double tolerance, int most, double *cost)
{
    double scale[FREE], theta[FREE], trial[FREE], d[FREE], damping = 1e-3, grow = 2;
    for (int i = 0; i < FREE; i++) scale[i] = p[which[i]], theta[i] = 1;
    Normal now = pass(p, theta, scale, x0, u, y, n, dt, steps);
    int passes = 1, done = 0;
    while (!done && passes < most) {
        if (!damped_step(&now, damping, d)) { damping *= 10; if (damping > 1e12) break; continue; }
        double promise = 0;
        for (int i = 0; i < FREE; i++) {
            if (theta[i] + d[i] < 0.1 * theta[i]) d[i] = -0.9 * theta[i];   /* all three stay positive */
            trial[i] = theta[i] + d[i];
        }
        for (int i = 0; i < FREE; i++) {
            promise += 2 * d[i] * now.g[i];
            for (int j = 0; j < FREE; j++) promise -= d[i] * now.H[i][j] * d[j];
        }
        if (damping <= 1e-3 && fabs(promise) < tolerance * now.cost) {
            memcpy(theta, trial, sizeof theta);
            now.cost -= promise;
            done = 1;
            break;
        }
        Normal next = pass(p, trial, scale, x0, u, y, n, dt, steps);
        passes++;
        double gain = (now.cost - next.cost) / promise;
        if (next.cost < now.cost) {
            memcpy(theta, trial, sizeof theta);
            now = next;
            damping *= fmax(1e-3, 1 - pow(2 * gain - 1, 3)), grow = 2;
        } else {
            damping = fmax(damping, 1e-6) * grow, grow *= 2;   /* also taken when the trial is NaN */
        }
    }
    for (int i = 0; i < FREE; i++) p[which[i]] = theta[i] * scale[i];
    *cost = now.cost;
    return done ? passes : -passes;
}
