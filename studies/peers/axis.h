/* Equations 1 to 11 of the servo-pneumatic axis with smooth dry friction, tanh(v / width), in SIMD lanes.
 *
 * LANES parameter sets run side by side. Both chambers of all sets share one vector of pressures:
 * lanes 0 .. LANES-1 hold chamber A, lanes LANES .. 2 LANES-1 chamber B. All quantities in SI units.
 * GCC's vector extensions carry the arithmetic, so the code compiles for any instruction set.
 */
#ifndef AXIS_H
#define AXIS_H
#include <math.h>
#include <stdint.h>
#ifdef __AVX512F__
#include <immintrin.h>
#endif

#ifndef LANES
#define LANES 4
#endif

typedef double V __attribute__((vector_size(8 * LANES)));    /* one number for each parameter set */
typedef double W __attribute__((vector_size(16 * LANES)));   /* one number for each chamber of each set */
typedef int64_t VI __attribute__((vector_size(8 * LANES)));
typedef int64_t WI __attribute__((vector_size(16 * LANES)));

enum {
    SUPPLY_PRESSURE, EXHAUST_PRESSURE, ATMOSPHERIC_PRESSURE, SUPPLY_TEMPERATURE, CHAMBER_TEMPERATURE,
    SPECIFIC_HEAT_RATIO, GAS_CONSTANT, PORT_WIDTH, SPOOL_TRAVEL, DISCHARGE_COEFFICIENT, BORE_DIAMETER,
    ROD_DIAMETER, STROKE, RESIDUAL_LENGTH, PAYLOAD_MASS, VISCOUS_FRICTION, COULOMB_FRICTION, FRICTION_WIDTH,
    FLOW_WIDTH, STOP_STIFFNESS, STOP_DAMPING, LENGTH_FLOOR, PARAMETERS
};
enum { DEGREE = 15 };   /* of the polynomial for the squared flow function: error below 1e-14 */

typedef struct { V x, v; W P; } State;

typedef struct {
    double P_supply, P_exhaust, half, floor, ring, friction_scale, stop_k, stop_c, K, flow_width2;
    double ratio_low, s_gain, s_shift, flow[DEGREE + 1];
    W gain_in, gain_out;      /* flow into a chamber as a rate of P times length, per unit of spool */
    V A_a, A_b, F_rod, inv_M, viscous, coulomb, Delta;
} Axis;

#if LANES == 1
#define BOTH(a, b) __builtin_shufflevector(a, b, 0, 1)
#define LOWER(w) __builtin_shufflevector(w, w, 0)
#define UPPER(w) __builtin_shufflevector(w, w, 1)
#else
#define BOTH(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7)
#define LOWER(w) __builtin_shufflevector(w, w, 0, 1, 2, 3)
#define UPPER(w) __builtin_shufflevector(w, w, 4, 5, 6, 7)
#endif
#define SPLAT_V(a) ((V){0} + (a))
#define SPLAT_W(a) ((W){0} + (a))

/* mask ? a : b lane by lane; C has no ?: for vectors. */
#define PICK_V(mask, a, b) ((V)(((mask) & (VI)(a)) | (~(mask) & (VI)(b))))
#define PICK_W(mask, a, b) ((W)(((mask) & (WI)(a)) | (~(mask) & (WI)(b))))

static inline V max_v(V a, V b) { return PICK_V(a > b, a, b); }

static inline W max_w(W a, W b)
{
#if defined(__AVX512F__) && LANES == 4
    return (W)_mm512_max_pd((__m512d)a, (__m512d)b);
#else
    return PICK_W(a > b, a, b);
#endif
}

static inline W min_w(W a, W b)
{
#if defined(__AVX512F__) && LANES == 4
    return (W)_mm512_min_pd((__m512d)a, (__m512d)b);
#else
    return PICK_W(a < b, a, b);
#endif
}

static inline int any_v(VI m)
{
    int64_t all = 0;
    for (int i = 0; i < LANES; i++) all |= m[i];
    return all != 0;
}

/* z^(-1/4) for z > 0: an estimate of 14 bits squared up twice by the series of (1 - e)^(-1/4). */
static inline W inverse_fourth_root(W z)
{
#if defined(__AVX512F__) && LANES == 4
    __m512d a = (__m512d)z;
    W y = (W)_mm512_rsqrt14_pd(_mm512_mul_pd(a, _mm512_rsqrt14_pd(a)));
    W y2 = y * y, e = 1.0 - z * y2 * y2;
    return y + y * e * (0.25 + e * (0.15625 + e * (0.1171875 + e * 0.09521484375)));
#else
    W root = z;
    for (int i = 0; i < 2 * LANES; i++) root[i] = sqrt(sqrt(z[i]));
    return 1.0 / root;
#endif
}

/* tanh to 1e-14 absolute, by exp(-2|y|) = 2^n exp(r) with a Taylor polynomial for |r| < ln(2)/2. */
static inline V tanh_v(V y)
{
    V a = PICK_V(y < 0.0, y, -y);
    a = 2.0 * max_v(a, SPLAT_V(-20.0));
    V shifted = a * 1.4426950408889634 + 6755399441055744.0;
    V n = shifted - 6755399441055744.0;
    V r = (a - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
    V r2 = r * r, r4 = r2 * r2;
    V low = (1.0 + r) + r2 * (0.5 + r * (1.0 / 6)) + r4 * ((1.0 / 24 + r * (1.0 / 120)) + r2 * (1.0 / 720 + r * (1.0 / 5040)));
    V high = (1.0 / 40320 + r * (1.0 / 362880)) + r2 * (1.0 / 3628800 + r * (1.0 / 39916800));
    V e = low + r4 * r4 * high;
    VI bits = ((VI)shifted - (VI)SPLAT_V(6755399441055744.0) + 1023) << 52;
    e = e * (V)bits;
    V t = (1.0 - e) / (1.0 + e);
    return PICK_V(y < 0.0, -t, t);
}

/* C_k^2 (r^(2/K) - r^((K+1)/K)), eq. 7 squared, for r in [C_r, 1]. */
static inline W flow_squared(const Axis *m, W r)
{
    const double *c = m->flow;
    W s = r * m->s_gain + m->s_shift, s2 = s * s, s4 = s2 * s2, s8 = s4 * s4;
    W a = (c[0] + s * c[1]) + s2 * (c[2] + s * c[3]) + s4 * ((c[4] + s * c[5]) + s2 * (c[6] + s * c[7]));
    W b = (c[8] + s * c[9]) + s2 * (c[10] + s * c[11]) + s4 * ((c[12] + s * c[13]) + s2 * (c[14] + s * c[15]));
    return a + s8 * b;
}

static inline V soft_floor(V l, double floor, double width)
{
    V d = l - floor + width, inside = d * d / (4 * width) + floor;
    return PICK_V(l > floor + width, l, PICK_V(l < floor - width, SPLAT_V(floor), inside));
}

static V stops(const Axis *m, V x, V v)
{
    V zero = {0}, low = max_v(-m->half - x, zero), high = max_v(x - m->half, zero), root_low = low, root_high = high;
    for (int i = 0; i < LANES; i++) root_low[i] = sqrt(low[i] + 1e-12), root_high[i] = sqrt(high[i] + 1e-12);
    return m->stop_k * low * root_low * max_v(1 - m->stop_c * v, zero)
         - m->stop_k * high * root_high * max_v(1 + m->stop_c * v, zero);
}

/* port: pressures behind the ports; open: |command| times the gains of flow into the chambers. */
static inline State rates(const Axis *m, State y, W port, W open_in, W open_out)
{
    V length_a = m->half + y.x + m->Delta, length_b = m->half - y.x + m->Delta;
    if (__builtin_expect(any_v((length_a < m->floor + m->ring) | (length_b < m->floor + m->ring)), 0)) {
        length_a = soft_floor(length_a, m->floor, m->ring);
        length_b = soft_floor(length_b, m->floor, m->ring);
    }
    WI inwards = port > y.P;
    W up = max_w(port, y.P), down = min_w(port, y.P);
    W r = max_w(down / up, SPLAT_W(m->ratio_low));
    W q = flow_squared(m, r);
    W f = q * inverse_fourth_root(q * q + m->flow_width2);
    W flow = up * f * PICK_W(inwards, open_in, -open_out);
    V F = m->A_a * LOWER(y.P) - m->A_b * UPPER(y.P) - m->F_rod;
    F -= m->viscous * y.v + m->coulomb * tanh_v(y.v * m->friction_scale);
    if (__builtin_expect(any_v((y.x < -m->half) | (y.x > m->half)), 0)) F += stops(m, y.x, y.v);
    State d;
    d.x = y.v;
    d.v = F * m->inv_M;
    W length = BOTH(length_a, length_b), v = BOTH(-y.v, y.v);
    d.P = (y.P * v + flow) * (m->K / length);
    return d;
}

static inline State along(State y, double h, State d)
{
    y.x += h * d.x;
    y.v += h * d.v;
    y.P += h * d.P;
    return y;
}

/* One sample interval under a held command: `steps` steps of the classical fourth-order Runge-Kutta method. */
static inline State hold(const Axis *m, State y, double command, int steps, double h)
{
    double a = command > 0 ? m->P_supply : m->P_exhaust, b = command > 0 ? m->P_exhaust : m->P_supply;
    W port = BOTH(SPLAT_V(a), SPLAT_V(b)), in = m->gain_in * fabs(command), out = m->gain_out * fabs(command);
    for (int i = 0; i < steps; i++) {
        State k1 = rates(m, y, port, in, out);
        State k2 = rates(m, along(y, h / 2, k1), port, in, out);
        State k3 = rates(m, along(y, h / 2, k2), port, in, out);
        State k4 = rates(m, along(y, h, k3), port, in, out);
        k2.x += k3.x, k2.v += k3.v, k2.P += k3.P;
        y = along(along(along(y, h / 6, k1), h / 3, k2), h / 6, k4);
    }
    return y;
}

/* Interpolate the squared flow function at Chebyshev points and write it in powers of s = (r - middle)/half. */
static void flow_polynomial(Axis *m, double K)
{
    const int n = DEGREE + 1;
    double C_k2 = 2 / (K - 1) * pow((K + 1) / 2, (K + 1) / (K - 1)), cheb[DEGREE + 1], before[DEGREE + 1] = {1};
    double now[DEGREE + 1] = {0, 1}, middle, half;
    m->ratio_low = pow(2 / (K + 1), K / (K - 1));
    middle = (1 + m->ratio_low) / 2, half = (1 - m->ratio_low) / 2;
    m->s_gain = 1 / half, m->s_shift = -middle / half;
    for (int k = 0; k < n; k++) {
        double sum = 0;
        for (int j = 0; j < n; j++) {
            double angle = M_PI * (j + 0.5) / n, r = middle + half * cos(angle);
            sum += C_k2 * (pow(r, 2 / K) - pow(r, (K + 1) / K)) * cos(k * angle);
        }
        cheb[k] = sum * (k ? 2.0 : 1.0) / n;
    }
    for (int i = 0; i < n; i++) m->flow[i] = cheb[0] * before[i] + cheb[1] * now[i];
    for (int k = 2; k < n; k++) {
        double next[DEGREE + 1];
        for (int i = 0; i < n; i++) next[i] = (i ? 2 * now[i - 1] : 0) - before[i];
        for (int i = 0; i < n; i++) m->flow[i] += cheb[k] * next[i], before[i] = now[i], now[i] = next[i];
    }
}

/* p[lane] points at the PARAMETERS numbers of that lane; those not fitted are read from lane 0. */
static void prepare(Axis *m, const double *const *p)
{
    const double *c = p[0];
    double K = c[SPECIFIC_HEAT_RATIO], R = c[GAS_CONSTANT];
    double C_0 = sqrt(K / R * pow(2 / (K + 1), (K + 1) / (K - 1)));
    double A_a = M_PI / 4 * c[BORE_DIAMETER] * c[BORE_DIAMETER];
    double A_rod = M_PI / 4 * c[ROD_DIAMETER] * c[ROD_DIAMETER], A_b = A_a - A_rod;
    m->P_supply = c[SUPPLY_PRESSURE], m->P_exhaust = c[EXHAUST_PRESSURE];
    m->half = c[STROKE] / 2, m->floor = c[LENGTH_FLOOR], m->ring = c[LENGTH_FLOOR] / 2, m->K = K;
    m->friction_scale = 1 / c[FRICTION_WIDTH], m->flow_width2 = c[FLOW_WIDTH] * c[FLOW_WIDTH];
    m->stop_k = c[STOP_STIFFNESS], m->stop_c = c[STOP_DAMPING];
    flow_polynomial(m, K);
    for (int i = 0; i < LANES; i++) {
        double g = R * c[SUPPLY_TEMPERATURE] * p[i][DISCHARGE_COEFFICIENT] * C_0 * c[PORT_WIDTH] * c[SPOOL_TRAVEL];
        m->gain_in[i] = g / A_a / sqrt(c[SUPPLY_TEMPERATURE]);
        m->gain_in[LANES + i] = g / A_b / sqrt(c[SUPPLY_TEMPERATURE]);
        m->gain_out[i] = g / A_a / sqrt(c[CHAMBER_TEMPERATURE]);
        m->gain_out[LANES + i] = g / A_b / sqrt(c[CHAMBER_TEMPERATURE]);
        m->viscous[i] = p[i][VISCOUS_FRICTION], m->coulomb[i] = p[i][COULOMB_FRICTION];
        m->A_a[i] = A_a, m->A_b[i] = A_b, m->F_rod[i] = A_rod * c[ATMOSPHERIC_PRESSURE];
        m->inv_M[i] = 1 / c[PAYLOAD_MASS], m->Delta[i] = c[RESIDUAL_LENGTH];
    }
}

static State start_state(const double *x0)
{
    return (State){SPLAT_V(x0[0]), SPLAT_V(x0[1]), BOTH(SPLAT_V(x0[2]), SPLAT_V(x0[3]))};
}
#endif
