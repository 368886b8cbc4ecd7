"""How long a diagnosis takes, beside refitting every effect of the catalogue in full.

    python studies/benchmark_diagnose.py [--quick]

Three recordings and one held out, 12 s at 1 kHz, position only, from the independent rig with a leaking rod seal.
The peer is what one would do without a screen: refit all parameters with every effect from each of its usual sizes,
and keep the one that predicts the hold-out best. Both use the same filter and the same search. `--quick` takes 3 s
recordings and every eighth effect for the peer, and says what that makes of the whole.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the studies are no package: find their neighbours from any folder

from optid.core.recording import Channel, Recording  # noqa: E402
from optid.diagnosis.evaluation import evaluate  # noqa: E402
from optid.diagnosis.pipeline import diagnose  # noqa: E402
from optid.effects.effect import Effect  # noqa: E402
from optid.effects.library import admitted  # noqa: E402
from optid.errors import SolveError  # noqa: E402
from optid.estimation.fisher_scoring import default_process_noise, likelihood_problem, maximise, point_at  # noqa: E402
from optid.estimation.likelihood import WHOLE  # noqa: E402
from optid.estimation.likelihood_point import LikelihoodFit, LikelihoodProblem  # noqa: E402
from optid.estimation.problem import build_problem  # noqa: E402
from optid.rigs.rigfile import Rig, read_rig, with_effects  # noqa: E402
from studies.independent_rig import recording, simulate  # noqa: E402
from studies.make_recording import WORN  # noqa: E402
from studies.references import mixed  # noqa: E402

SEED = 7


@dataclass(frozen=True)
class Timed:
    """One way to a name: seconds, the name, and what of the whole was done."""

    seconds: float
    name: str
    share: float


def recordings(seconds: float) -> list[Recording]:
    """Four recordings of the worn rig."""
    made = []
    for number in range(4):
        rng = np.random.default_rng([SEED, number])
        table = recording(simulate(WORN, mixed(seconds, 1e-3, rng, 0.1), rng), rng)
        channels = {
            "command": Channel(
                "command", "u", "1", table["u"].to_numpy() / 5.0, full_scale=1.0, per_unit=5.0
            ),
            "position": Channel("position", "x", "m", table["x"].to_numpy() * 1e-3),
        }
        made.append(Recording(f"run{number}", table["t"].to_numpy(), channels))
    return made


def screened(rig: Rig, train: Sequence[Recording], held: Sequence[Recording]) -> Timed:
    """The diagnosis as the command runs it."""
    start = time.perf_counter()
    found = diagnose(rig, train, held)
    names = ", ".join(f.effect.name if f.effect else "unexplained" for f in found.findings)
    return Timed(time.perf_counter() - start, names or found.verdict.value, 1.0)


def exhaustive(rig: Rig, train: Sequence[Recording], held: Sequence[Recording], every: int) -> Timed:
    """Every effect refitted from every usual size; one round, so that a second effect is not even looked for."""
    start = time.perf_counter()
    question = likelihood_problem(rig, build_problem(rig.model, train, WHOLE))
    base = _likeliest(question, rig.model.vector(rig.parameters)).p
    scores: dict[str, float] = {}
    effects = admitted(rig.model)
    for effect in effects[::every]:
        scores[effect.name] = min(_refit(rig, effect, branch, base, train, held) for branch in effect.usual)
    best = min(scores, key=lambda name: scores[name])
    return Timed(time.perf_counter() - start, best, len(effects[::every]) / len(effects))


def _refit(
    rig: Rig,
    effect: Effect,
    branch: Mapping[str, float],
    p0: np.ndarray,
    train: Sequence[Recording],
    held: Sequence[Recording],
) -> float:
    grown = with_effects(rig, (effect,), effect.qualified({**effect.at_null(), **branch}))
    model = grown.model
    p = model.vector(grown.parameters)
    p[[model.index(parameter.name) for parameter in rig.model.parameters]] = p0
    try:
        answer = _likeliest(likelihood_problem(grown, build_problem(model, train, WHOLE), rig.model), p)
    except SolveError:  # from this size the simulation diverges
        return math.inf
    q = answer.likelihood_problem
    noise = {port.role: float(v) ** 0.5 for port, v in zip(model.outputs, q.measurement, strict=True)}
    return evaluate(q, answer.p, answer.noise, held).error_over_noise(noise)


def _likeliest(question: LikelihoodProblem, p: np.ndarray) -> LikelihoodFit:
    return maximise(point_at(question, p, default_process_noise(question)))


def main() -> None:
    """Print both, side by side."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument(
        "--every", type=int, help="the peer refits each so many-th effect; 8 when quick, else 1"
    )
    asked = parser.parse_args()
    quick, every = asked.quick, asked.every or (8 if asked.quick else 1)
    made = recordings(3.0 if quick else 12.0)
    rig = read_rig(ROOT / "data" / "bench.toml")
    print(f"{'':24}{'seconds':>9}  answer")
    ours = screened(rig, made[:3], made[3:])
    print(f"{'optid diagnose':24}{ours.seconds:9.1f}  {ours.name}", flush=True)
    peer = exhaustive(rig, made[:3], made[3:], every)
    whole = peer.seconds / peer.share
    print(f"{'every effect in full':24}{whole:9.1f}  {peer.name}" + (" (of a sample)" if every > 1 else ""))
    print(f"ratio {whole / ours.seconds:.1f}")


if __name__ == "__main__":
    main()
