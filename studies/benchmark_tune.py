"""What tuning costs in time, by every route, in one run on one machine.

    python studies/benchmark_tune.py [--control] [--repeats N]

The case: ITAE of a 6 cm step over 2000 samples at 1 kHz, command within +-5 V, kp, ki and kd to be found, on an
order-4 ARMAX model identified from data/bench.csv. The cost to reach is what SciPy's differential evolution finds
with all the time it wants. Nelder-Mead starts from Ziegler and Nichols' gains, as in practice. With --control it is
run over python-control's `input_output_response` too, which takes a minute; without, one simulation is timed and
multiplied by the evaluations that the plain loop's Nelder-Mead took. Stopped early means after 150 evaluations.
CasADi and IPOPT start from the same gains; their time has the loop's unrolling in it.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax import Armax, Orders
from optid.armax.batch import fit_batch
from optid.pid.controller import Gains, Settings
from optid.tuning.baselines import ziegler_nichols_ultimate
from optid.tuning.optimise import Options, default_gains, optimise
from optid.tuning.plant import plant_of
from optid.tuning.scenarios import step
from optid.tuning.search import box
from optid.tuning.task import Task
from optid.tuning.ultimate import ultimate
from studies.peers import tune_casadi

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
T, SAMPLES, STEP, LIMIT = 1e-3, 2000, 0.06, 5.0
EARLY = 150  # evaluations after which a Nelder-Mead is stopped early
QUICK = Options(free=("kp", "ki", "kd"), starts=1, grid=0, polish=False)
POLISHED = Options(free=("kp", "ki", "kd"), starts=1, grid=0)


def identified() -> Armax:
    """Order 4 with a delay of two samples, from the bench's recording: position (m) from command (V)."""
    table = pd.read_csv(ROOT / "data" / "bench.csv")
    record = (table["x"].to_numpy() * 1e-3, table["u"].to_numpy())
    return fit_batch([record], Orders(4, (4,), 4, (2,)), T).model


def padded(model: Armax) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """a after the leading one and b from one delay on, of one length."""
    a, b = model.a[1:], (0.0,) * (model.nk[0] - 1) + model.b[0]
    order = max(len(a), len(b))
    return a + (0.0,) * (order - len(a)), b + (0.0,) * (order - len(b))


def in_casadi(
    model: Armax, lag: float, start: Array, cost: Callable[[Array], float], reference: float
) -> None:
    """Print the row of CasADi and IPOPT; what its gains cost is told by the plain loop."""
    begin = time.perf_counter()
    found = tune_casadi.tune(
        *padded(model), start, lag, samples=SAMPLES, sample_time=T, size=STEP, limit=LIMIT
    )
    seconds = time.perf_counter() - begin
    print(
        f"CasADi and IPOPT, {found.iterations} iterations ({found.outcome}): {seconds:.3f} s, "
        f"{cost(np.array(found.gains)) / reference:.4f} times that cost"
    )


def scalar_loop(model: Armax, lag: float) -> Callable[[Array], float]:
    """ITAE of gains (kp, ki, kd) in plain Python: the same loop, written out."""
    a, b = padded(model)
    order = len(a)

    def cost(gains: Array) -> float:
        kp, ki, kd = (float(g) for g in gains)
        z = [0.0] * (order + 1)
        integral = slope = last = total = 0.0
        for n in range(SAMPLES):
            y = z[0]
            e = STEP - y
            slope = (lag * slope - (y - last)) / (lag + T)
            last = y
            grown = ki * T * e
            wish = kp * e + (integral + grown) + kd * slope
            u = min(max(wish, -LIMIT), LIMIT)
            if (wish - u) * grown <= 0.0:
                integral += grown
            total += T * (n * T) * abs(e)
            for i in range(order):
                z[i] = z[i + 1] + b[i] * u - a[i] * y
        return total if total == total else float("inf")

    return cost


def control_loop(model: Armax, lag: float) -> Callable[[Array], float]:
    """The same through python-control's nonlinear input/output systems."""
    import control

    A, B, C, _ = model.matrices()

    def cost(gains: Array) -> float:
        kp, ki, kd = (float(g) for g in gains)

        def parts(x: Array, v: Array) -> tuple[float, float, float, float]:
            e = v[0] - v[1]
            slope = (lag * x[1] - (v[1] - x[2])) / (lag + T)
            grown = ki * T * e
            return slope, grown, kp * e + (x[0] + grown) + kd * slope, e

        def update(t: float, x: Array, v: Array, params: object) -> list[float]:
            slope, grown, wish, _ = parts(x, v)
            u = min(max(wish, -LIMIT), LIMIT)
            return [x[0] + (grown if (wish - u) * grown <= 0.0 else 0.0), slope, v[1]]

        def output(t: float, x: Array, v: Array, params: object) -> list[float]:
            return [min(max(parts(x, v)[2], -LIMIT), LIMIT)]

        pid = control.nlsys(update, output, inputs=["r", "y"], outputs=["u"], states=3, dt=T, name="pid")
        plant = control.ss(A, B, C, 0, T, inputs=["u"], outputs=["y"], name="plant")
        loop = control.interconnect([pid, plant], inputs=["r"], outputs=["y"])
        time_grid = T * np.arange(SAMPLES)
        response = control.input_output_response(loop, time_grid, STEP * np.ones(SAMPLES))
        return float(np.sum(T * time_grid * np.abs(STEP - np.ravel(response.outputs))))

    return cost


def simplex(cost: Callable[[Array], float], start: Array, most: int) -> tuple[float, int, float]:
    """Nelder-Mead as SciPy has it: cost reached, evaluations, seconds."""
    from scipy.optimize import minimize

    begin = time.perf_counter()
    found = minimize(cost, start, method="Nelder-Mead", options={"maxfev": most})
    return float(found.fun), int(found.nfev), time.perf_counter() - begin


def timed(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Least and median seconds."""
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begin)
    return min(seconds), float(np.median(seconds))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--control", action="store_true")
    parser.add_argument("--repeats", type=int, default=9)
    arguments = parser.parse_args()
    model = identified()
    plant = plant_of(model)
    task = Task((plant,), (step(STEP, SAMPLES, T),), Settings(T, -LIMIT, LIMIT))
    scale = ultimate(plant)
    fixed = default_gains(task, scale)
    lag = fixed.derivative_filter
    start = ziegler_nichols_ultimate(scale, lag).vector[:3]
    print(f"model: {model}")
    plain, slow = scalar_loop(model, lag), control_loop(model, lag)
    check = np.array([task.closed_loop.costs(Gains(*start, lag).vector)[0, 0], plain(start), slow(start)])
    print(f"one cost by the three routes: {', '.join(f'{c:.9e}' for c in check)}")
    np.testing.assert_allclose(check, check[0], rtol=1e-6)

    vectors = np.tile(Gains(*start, lag).vector, (64, 1))
    batch = timed(lambda: task.closed_loop.costs(vectors), arguments.repeats)[0] / 64
    python_one, control_one = timed(lambda: plain(start), 5)[0], timed(lambda: slow(start), 3)[0]
    print(
        f"one cost: compiled {1e6 * batch:.1f} us, plain Python {1e6 * python_one:.0f} us, "
        f"python-control {1e6 * control_one:.0f} us"
    )

    reference = best_known(task)
    print(f"differential evolution (SciPy, long): {reference:.6e}")
    found = {}
    for name, begin, most in (
        ("", start, 600),
        (", stopped early", start, EARLY),
        (", from gains of 1", np.ones(3), 600),
    ):
        reached, evaluations, seconds = min(
            (simplex(plain, begin, most) for _ in range(3)), key=lambda run: run[2]
        )
        found[name] = seconds, evaluations
        print(
            f"Nelder-Mead over plain Python{name}: {seconds:.3f} s, {evaluations} evaluations, "
            f"{reached / reference:.4f} times that cost"
        )
    in_casadi(model, lag, start, plain, reference)
    if arguments.control:
        far, count, control_seconds = simplex(slow, start, EARLY)
        print(
            f"Nelder-Mead over python-control, stopped early: {control_seconds:.1f} s, {count} evaluations, "
            f"{far / reference:.4f} times that cost"
        )
    else:
        control_seconds = control_one * found[", stopped early"][1]
        print(f"Nelder-Mead over python-control, stopped early: {control_seconds:.1f} s by its evaluations")
    for name, options in (("search", QUICK), ("search and polish", POLISHED)):
        optimise(task, options, np.random.default_rng(0))
        costs, seconds_each = [], []
        for seed in range(arguments.repeats):
            begin_at = time.perf_counter()
            gains = optimise(task, options, np.random.default_rng(seed), scale).gains
            seconds_each.append(time.perf_counter() - begin_at)
            costs.append(task.fitness(gains.vector)[0] / reference)
        least = min(seconds_each)
        ratios = f"{found[''][0] / least:.1f}, stopped early {found[', stopped early'][0] / least:.1f}"
        print(
            f"optid, {name}: {least:.3f} s (median {np.median(seconds_each):.3f}), {max(costs):.5f} times that cost "
            f"at worst of {len(costs)} seeds; times faster than Nelder-Mead over plain Python {ratios}; "
            f"than over python-control {control_seconds / least:.0f}"
        )


def best_known(task: Task) -> float:
    """The cost that SciPy's differential evolution reaches with all the time it wants."""
    from scipy.optimize import differential_evolution

    scale = ultimate(task.plant)
    within = box(("kp", "ki", "kd"), default_gains(task, scale), scale)
    found = differential_evolution(
        lambda points: task.fitness(within.gains(points.T)),
        [(0.0, 1.0)] * 3,
        popsize=40,
        maxiter=400,
        tol=1e-8,
        rng=np.random.default_rng(0),
        vectorized=True,
        updating="deferred",
    )
    return float(found.fun)


if __name__ == "__main__":
    main()
