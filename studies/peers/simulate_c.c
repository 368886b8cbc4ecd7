/* Simulation of one parameter set: both chambers in the lanes of one vector. */
#define LANES 1
#include "axis.h"

/* States x, v, P_a, P_b at the n samples: out[k] is the state when u[k] takes hold; out[n] the one at the end. */
void simulate(const double *p, const double *x0, const double *u, int n, double dt, int steps, double *out)
{
    Axis m;
    const double *sets[1] = {p};
    prepare(&m, sets);
    State s = start_state(x0);
    for (int k = 0; k <= n; k++) {
        out[4 * k] = s.x[0], out[4 * k + 1] = s.v[0], out[4 * k + 2] = s.P[0], out[4 * k + 3] = s.P[1];
        if (k < n) s = hold(&m, s, u[k], steps, dt / steps);
    }
}
