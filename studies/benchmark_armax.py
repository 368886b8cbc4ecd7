"""What the recursive identifier is worth, measured: speed beside its peers, truth, agreement, idling.

    python studies/benchmark_armax.py [speed] [truth] [agreement] [idle] [--quick]

speed: order 4, 12 parameters, all routes in one run on one machine; prints the two ratios asked for.
truth: 100 seeds of a system that is known. agreement: with batch estimates. idle: 10^7 samples without
excitation, then 50 rich ones. padasip is optional (`pip install padasip`); the C routes need gcc.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax import (
    Armax,
    Constant,
    Directional,
    Identifier,
    Method,
    Orders,
    Settings,
    Variable,
    exact_start,
    identify,
)
from optid.armax.batch import fit_batch
from optid.armax.export_c import identifier_header
from optid.armax.regression import arx_rows, least_squares
from optid.armax.signals import signals

Array = NDArray[np.float64]
LAMBDA = 0.9995
ORDER_4 = Armax(
    a=(1.0, -1.5, 0.9, -0.3, 0.05),
    b=((1.0, 0.5, 0.2, 0.1),),
    c=(1.0, 0.3, 0.2, 0.1, 0.05),
    nk=(1,),
    noise_variance=0.01,
)
# The case of the issue; a binary input that switches with probability 0.08 a sample.
TRUTH = Armax(
    a=(1.0, -2.21, 1.7494, -0.584256, 0.0684029),
    b=((1.5, -2.07, 1.3146),),
    c=(1.0, 0.3, 0.2),
    nk=(11,),
    noise_variance=0.01,
)

# Bierman's update with lambda, written plainly for 12 parameters and a given regressor: the least one can do.
PLAIN_C = """
#define N 12
void plain(double *theta, double *D, double *U, const double *X, const double *y, long n,
           double lambda, double *e)
{
    for (long t = 0; t < n; t++) {
        const double *x = X + t * N;
        double f[N], g[N], alpha = lambda, error = y[t];
        for (int j = 0; j < N; j++)
            error -= x[j] * theta[j];
        for (int j = 0; j < N; j++) {
            double s = x[j];
            for (int i = 0; i < j; i++)
                s += U[j * N + i] * x[i];
            f[j] = s;
        }
        for (int j = 0; j < N; j++) {
            double v = D[j] * f[j], next = alpha + f[j] * v, p = -f[j] / alpha;
            D[j] = D[j] * alpha / (next * lambda);
            for (int i = 0; i < j; i++) {
                double u = U[j * N + i];
                U[j * N + i] = u + p * g[i];
                g[i] += v * u;
            }
            g[j] = v;
            alpha = next;
        }
        for (int j = 0; j < N; j++)
            theta[j] += g[j] * error / alpha;
        e[t] = error;
    }
}
"""


def main() -> None:
    """Run the parts asked for, all where none is named."""
    parts = {"speed": speed, "truth": truth, "agreement": agreement, "idle": idle}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", nargs="*", choices=[*parts, []])
    parser.add_argument("--quick", action="store_true", help="fewer seeds and samples")
    arguments = parser.parse_args()
    for name in arguments.part or parts:
        parts[name](arguments.quick)


def simulate(model: Armax, N: int, rng: np.random.Generator, switch: float) -> tuple[Array, Array]:
    """y and u: binary input, white noise."""
    u = np.where(np.cumsum(rng.random(N) < switch) % 2, 1.0, -1.0)
    e = np.sqrt(model.noise_variance) * rng.standard_normal(N)
    taps = np.concatenate([np.zeros(model.nk[0]), model.b[0]])
    return lfilter(taps, model.a, u) + lfilter(model.c, model.a, e), u


# Speed.


def speed(quick: bool) -> None:
    """Microseconds a sample of every route."""
    N = 20_000  # some milliseconds a run: the shortest of many is then one that nothing interrupted
    repeats = 20 if quick else 200
    y, u = simulate(ORDER_4, N, np.random.default_rng(0), 0.3)
    Phi, target = arx_rows(signals(y, u), Orders(4, (8,), 0, (1,)))  # 12 regressors for those that take rows
    extended = Settings(method=Method.EXTENDED_LEAST_SQUARES, forgetting=Constant(LAMBDA))
    likelihood = Settings(forgetting=Constant(LAMBDA))
    arrays: dict[str, float] = {}
    for name, settings in (("extended", extended), ("likelihood", likelihood)):
        identifier = Identifier(ORDER_4.orders, settings=settings, tailored=True)
        arrays[f"optid, {name}"] = best(lambda i=identifier: i.run(y, u), repeats) / N
        usual = Identifier(ORDER_4.orders, settings=settings)
        arrays[f"optid not tailored to the orders, {name}"] = best(lambda i=usual: i.run(y, u), repeats) / N
        if shutil.which("gcc"):
            arrays[f"the same in C, {name}"] = exported(identifier, y, u, repeats) / N
    if shutil.which("gcc"):
        arrays["bare recursion in C, rows given"] = plain(Phi, target, repeats) / len(target)
    else:
        print("no gcc: the C routes are left out")
    rows = 2000
    arrays["numpy textbook, rows given"] = (
        best(lambda: textbook(Phi[:rows], target[:rows]), repeats // 10) / rows
    )
    if importlib.util.find_spec("padasip"):
        arrays["padasip, rows given"] = best(lambda: padasip(Phi[:rows], target[:rows]), repeats // 10) / rows
    else:
        print("padasip is not installed: left out")
    print("\nOver an array, order 4 (12 parameters), microseconds a sample")
    for name, seconds in sorted(arrays.items(), key=lambda pair: pair[1]):
        print(f"  {1e6 * seconds:8.3f}  {name}")
    ratios(arrays)
    for name, settings in (("extended", extended), ("likelihood", likelihood)):
        each = calls(Identifier(ORDER_4.orders, settings=settings, tailored=True), y.tolist(), u.tolist())
        print(f"One call of `step` from Python, {name}: median {1e6 * np.median(each):.3f} microseconds")


def ratios(arrays: dict[str, float]) -> None:
    """The two figures asked for."""
    for name in ("extended", "likelihood"):
        own = arrays[f"optid, {name}"]
        said = [f"optid, {name}:"]
        if "padasip, rows given" in arrays:
            said.append(f"{arrays['padasip, rows given'] / own:.0f} times faster than padasip;")
        if f"the same in C, {name}" in arrays:
            said.append(f"{own / arrays[f'the same in C, {name}']:.2f} times the same recursion in C,")
            said.append(f"{own / arrays['bare recursion in C, rows given']:.2f} times the bare one")
        print("  " + " ".join(said))


def best(run: Callable[[], object], repeats: int) -> float:
    """Shortest of several runs, s."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def calls(identifier: Identifier, y: list[float], u: list[float]) -> Array:
    """Seconds a call, each the mean of 100 calls in a row, loop included."""
    step, clock = identifier.step, time.perf_counter
    out = []
    for first in range(0, len(y) - 100, 100):
        pairs = list(zip(y[first : first + 100], u[first : first + 100], strict=True))
        start = clock()
        for a, b in pairs:
            step(a, b)
        out.append((clock() - start) / 100)
    return np.array(out)


def textbook(Phi: Array, y: Array) -> Array:
    """Recursive least squares as textbooks write it, in numpy."""
    n = Phi.shape[1]
    theta, P = np.zeros(n), 1e4 * np.eye(n)
    for x, target in zip(Phi, y, strict=True):
        K = P @ x / (LAMBDA + x @ P @ x)
        theta = theta + K * (target - x @ theta)
        P = (P - np.outer(K, x) @ P) / LAMBDA
    return theta


def padasip(Phi: Array, y: Array) -> Array:
    """The peer's recursive least squares over the whole array."""
    import padasip as pa

    return np.asarray(pa.filters.FilterRLS(n=Phi.shape[1], mu=LAMBDA, w="zeros").run(y, Phi)[0])


def pointer(x: Array) -> object:
    """For ctypes."""
    return x.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def library(source: str, folder: str) -> ctypes.CDLL:
    """Compile C with gcc -O3 and load it."""
    (Path(folder) / "main.c").write_text(source)
    command = ["gcc", "-O3", "-std=c99", "-shared", "-fPIC", "main.c", "-o", "main.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(Path(folder) / "main.so"))


def exported(identifier: Identifier, y: Array, u: Array, repeats: int) -> float:
    """Seconds of the exported C over the whole array."""
    source = identifier_header(identifier, "rig") + (
        "void go(double *m, const double *y, const double *u, long n, double *e) {"
        " for (long t = 0; t < n; t++) e[t] = rig_step(m, y[t], u + t); }\n"
    )
    memory, e = identifier.state, np.empty(y.size)
    with tempfile.TemporaryDirectory() as folder:
        go = library(source, folder).go
        arrays, size = [pointer(x) for x in (memory, y, u)], ctypes.c_long(y.size)
        return best(lambda: go(*arrays, size, pointer(e)), repeats)


def plain(Phi: Array, y: Array, repeats: int) -> float:
    """Seconds of the bare recursion in C over the whole array."""
    n = Phi.shape[1]
    theta, D, U, e = np.zeros(n), np.full(n, 1e4), np.eye(n), np.empty(y.size)
    Phi = np.ascontiguousarray(Phi)
    with tempfile.TemporaryDirectory() as folder:
        go = library(PLAIN_C, folder).plain
        size, forget = ctypes.c_long(y.size), ctypes.c_double(LAMBDA)
        arrays = [pointer(x) for x in (theta, D, U, Phi, y)]
        return best(lambda: go(*arrays, size, forget, pointer(e)), repeats)


# Truth, agreement, idling.


def truth(quick: bool) -> None:
    """Relative parameter error |theta - truth| / |truth| over seeds 0 to 99, 4001 samples."""
    routes: dict[str, Callable[[Array, Array], Armax]] = {
        "recursive maximum likelihood": lambda y, u: identify(y, u, TRUTH.orders).model,
        "recursive extended least squares": lambda y, u: (
            identify(y, u, TRUTH.orders, settings=Settings(method=Method.EXTENDED_LEAST_SQUARES)).model
        ),
        "batch": lambda y, u: fit_batch([(y, u)], TRUTH.orders).model,
    }
    print("\nTruth known: relative parameter error")
    for name, route in routes.items():
        errors = []
        for seed in range(10 if quick else 100):
            y, u = simulate(TRUTH, 4001, np.random.default_rng(seed), 0.08)
            errors.append(np.linalg.norm(route(y, u).theta - TRUTH.theta) / np.linalg.norm(TRUTH.theta))
        print(f"  {name}: median {np.median(errors):.4f}, largest {max(errors):.4f} of {len(errors)} seeds")


def agreement(quick: bool) -> None:
    """Recursive against batch: exactly for ARX, ever closer for maximum likelihood."""
    system = Armax(a=TRUTH.a, b=TRUTH.b, nk=TRUTH.nk, noise_variance=0.01)
    y, u = simulate(system, 4001, np.random.default_rng(0), 0.08)
    identifier = Identifier(system.orders, scales=signals(y, u).scales)
    used = exact_start(identifier, y, u)
    identifier.run(y[used:], u[used:])
    gap = np.max(np.abs(identifier.theta - least_squares([signals(y, u)], system.orders)))
    print(f"\nARX at lambda = 1 with exact start: largest difference to batch least squares {gap:.1e}")
    print("Maximum likelihood: root mean square distance to the batch estimate, in its standard errors")
    for N in (1000, 10_000) if quick else (1000, 10_000, 100_000, 1_000_000):
        apart = []
        for seed in range(3):
            y, u = simulate(TRUTH, N, np.random.default_rng(seed), 0.08)
            batch = fit_batch([(y, u)], TRUTH.orders).model
            recursive = identify(y, u, TRUTH.orders).model
            apart.append(np.sqrt(np.mean(((recursive.theta - batch.theta) / batch.standard_errors) ** 2)))
        print(f"  {N:8d} samples: {np.mean(apart):.3f}")


def idle(quick: bool) -> None:
    """10^7 samples without excitation, then 50 rich ones: largest relative error of any parameter.

    rest: everything zero. held: input and output constant. hum: input zero, the noise goes on. In the first two
    nothing tells of C while it lasts, so C is what was learnt before: the memory must be long enough for it
    (one of M samples leaves c1 = 0.5 open to about 1.7 / sqrt(M)), and idling must not spoil it.
    """
    N = 200_000 if quick else 10_000_000
    arx = Armax(a=(1.0, -1.5, 0.7), b=((1.0, 0.5),), nk=(1,))
    armax = Armax(a=(1.0, -1.5, 0.7), b=((1.0, 0.5),), c=(1.0, 0.5), nk=(1,))
    short = (Constant(0.99), Variable(300.0, 0.9), Directional(0.99))
    long = (Constant(1.0), Constant(0.9998), Variable(10_000.0, 0.9), Directional(0.9998))
    print(f"\nIdle for {N} samples, then 50 rich ones; noise 0.001, input 1; errors of A and B | of C")
    for title, system, laws, first in (
        ("ARX, 20000 rich samples before", arx, (*short, *long), 20_000),
        ("ARX, nothing before", arx, (*short, *long), 0),
        ("ARMAX, 20000 rich samples before, memory long enough for C", armax, long, 20_000),
        ("ARMAX, 20000 rich samples before, memory of 100 to 300 samples", armax, short, 20_000),
    ):
        print(f" {title}")
        for law in laws:
            for kind in ("rest", "held", "hum"):
                print(f"  {law!s:36} {kind:4}: {_idle(system, law, kind, N, first)}")


def _idle(system: Armax, law: Constant | Variable | Directional, kind: str, N: int, first: int) -> str:
    rng, last = np.random.default_rng(0), 50
    u = np.where(np.cumsum(rng.random(first + N + last) < 0.3) % 2, 1.0, -1.0)
    e = 1e-3 * rng.standard_normal(u.size)
    u[first : first + N] = 1.0 if kind == "held" else 0.0
    if kind != "hum":
        e[first : first + N] = 0.0
    y = lfilter([0.0, *system.b[0]], system.a, u) + lfilter(system.c, system.a, e)
    identifier = Identifier(system.orders, settings=Settings(forgetting=law, noise=1e-3))

    def errors() -> str:
        off = 100 * np.abs(identifier.theta / system.theta - 1.0)
        return f"{off[:4].max():.2f}" + (f" | {off[4]:.2f} %" if off.size > 4 else " %")

    identifier.run(y[:first], u[:first])
    before = f"before {errors()}, " if first else ""
    identifier.run(y[first : first + N], u[first : first + N])
    trace, largest = np.trace(identifier.scaled_covariance), np.max(np.abs(identifier.theta))
    identifier.run(y[first + N :], u[first + N :])
    return f"{before}after {errors()}; idle: trace of P {trace:.2g}, largest parameter {largest:.2f}"


if __name__ == "__main__":
    main()
