"""What each part of the diagnosis' search gains: every case with it and without it, in pairs.

    python studies/concealed.py draw --count 30 --seed S --open --out DIR
    python studies/ablation.py run DIR [--only steps,restart] [--cases 30]
    python studies/ablation.py table DIR

DIR holds cases of any plant, each with rig.toml, its recordings and answer.json. A row a case and variant is written as
it ends, to DIR/ablation.jsonl, and `run` goes on where it was stopped. The search is deterministic: where a part did
nothing in a case, the case is not run without it, and its row has the time that the part took less. `table` sets each
variant beside the search as it is: how many cases lose their right answer and how many win one, with the 95 % interval
of the difference (Newcombe, Statist. Med. 17, 1998, method 10), and the ratio of processor seconds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.stats import norm

sys.path.insert(0, str(Path(__file__).parents[1]))  # finds the studies beside it from any folder

from optid.core.budget import Budget
from optid.core.readers import read_recording
from optid.diagnosis import pipeline, proposals, verdict
from optid.diagnosis.criteria import SearchOptions
from optid.diagnosis.result import Diagnosis
from optid.diagnosis.selection import forward, stepwise
from optid.estimation import fixed_gain, multistep
from optid.rigs.rigfile import read_rig
from studies.trial.record import HELD_OUT, TRAIN
from studies.trial.running import cases_of

AS_IS = "as it is"
Patches = Mapping[tuple[Any, str], Any]


@dataclass(frozen=True)
class Variant:
    """A search without something.

    Attributes:
        words: what is left out or set otherwise.
        options: fields of `SearchOptions` that differ.
        patches: (module, name): what stands there instead.
        idle: of a call of the one patched function, by its result and arguments: whether what stands there instead
            would have returned the same; ``None`` where only a run tells.
    """

    words: str
    options: Mapping[str, Any] = field(default_factory=dict)
    patches: Patches = field(default_factory=dict)
    idle: Callable[..., bool] | None = None


def _never(*_: Any, **__: Any) -> None:
    return None


def _no(*_: Any, **__: Any) -> bool:
    return False


def _first_given(one: Any, *_: Any, **__: Any) -> Any:
    return one


def _is_none(found: Any, *_: Any) -> bool:
    return found is None


def _is_false(found: Any, *_: Any) -> bool:
    return not found


def _is_given(found: Any, one: Any, *_: Any) -> bool:
    return found is one


def _nothing_compared(found: Any, path: Any, *_: Any) -> bool:
    return found[0] is path and not any(found[1].values())


def _all_compete(current: Any, effects: Any, problem: Any, promise: Any = None, *given: Any) -> Any:
    return proposals.propose(current, effects, problem, None, *given)


VARIANTS = {
    AS_IS: Variant("nothing"),
    "steps": Variant("the linear step alone ranks effects", {"proposal_steps": 0}),
    "promise": Variant(
        "all branches compete, also from a model at the noise", {}, {(forward, "propose"): _all_compete}
    ),
    "contenders": Variant("one effect a round is fitted in full", {"contenders": 1}),
    "short windows": Variant("effects are first fitted by whole windows", {"short": 1.0}),
    "falling": Variant("a fit ends after its turns, falling or not", {}, {(multistep, "FALLING"): np.inf}),
    "restart": Variant(
        "a round is not repeated from a better base", {}, {(stepwise, "_restarted"): _never}, _is_none
    ),
    "stated values": Variant(
        "the first round does not begin again from the rig file's values",
        {},
        {(stepwise, "_restarted_from_stated_values"): _first_given},
        _is_given,
    ),
    "alternatives": Variant(
        "look-alikes are not tried in place",
        {},
        {(pipeline, "compare_alternatives"): lambda path, _: (path, {})},
        _nothing_compared,
    ),
    "bounds": Variant(
        "bounds of the rig file are never lifted", {}, {(pipeline, "relax_bounds"): _never}, _is_none
    ),
    "straight inputs": Variant(
        "inputs are held between samples", {}, {(pipeline, "inputs_that_go_on"): lambda *_: ()}, _is_false
    ),
    "full rate": Variant(
        "nothing is searched at the recordings' own rate", {}, {(pipeline, "at_full_rate"): _never}, _is_none
    ),
    "sticking input": Variant(
        "an input that sticks never stands in place of a law of that input",
        {},
        {(pipeline, "find_sticking_input"): _never},
        _is_none,
    ),
    "elsewhere": Variant(
        "a description elsewhere never speaks against a name",
        {},
        {(pipeline, "is_explained_elsewhere"): _no},
        _is_false,
    ),
    "contradicted": Variant(
        "a selected effect that the hold-out contradicts leaves a suspicion",
        {},
        {(verdict, "_is_contradicted"): _no},
        _is_false,
    ),
    "alone": Variant(
        "a name beside an unconfirmed one need not gain alone",
        {},
        {(verdict, "_why_not_alone"): lambda _: ""},
        _is_false,
    ),
    "rate": Variant("the search goes over all samples", {"rate": 1e9}),
    "tolerance": Variant("the search integrates as accurately as the test", {"tolerance": 1e-5}),
    "updated slopes": Variant("slopes are simulated for every step", {}, {(fixed_gain, "MISSED"): 0.0}),
    "near": Variant("other starts and effects are fitted whatever they leave", {"near": np.inf}),
}


@dataclass(frozen=True)
class Row:
    """One case by one variant."""

    case: str
    variant: str
    kind: str
    effects: tuple[str, ...]
    named: tuple[str, ...]
    verdict: str
    right: bool
    wrong_name: bool
    error: float
    seconds: float
    idle: Mapping[str, float] = field(
        default_factory=dict
    )  # parts that did nothing: processor seconds of each


@contextmanager
def recorded(idle: dict[str, float]) -> Iterator[None]:
    """The search as it is; what its parts took in `idle`, without those that did something."""
    acted = set()

    def observed(name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            began = time.process_time()
            found = original(*given, **named)
            idle[name] += time.process_time() - began
            if not VARIANTS[name].idle(found, *given):  # type: ignore[misc]
                acted.add(name)
            return found

        return call

    with ExitStack() as stack:
        for name, variant in VARIANTS.items():
            if variant.idle is not None:
                idle[name] = 0.0
                ((module, of),) = variant.patches
                stack.enter_context(patch.object(module, of, observed(name, getattr(module, of))))
        yield
    for name in acted:
        del idle[name]


@contextmanager
def without(variant: Variant) -> Iterator[SearchOptions]:
    """The options of a variant, with its patches in place."""
    with ExitStack() as stack:
        for (module, name), instead in variant.patches.items():
            stack.enter_context(patch.object(module, name, instead))
        yield replace(SearchOptions(), **variant.options)


def judged(case: Path, name: str, result: Diagnosis, seconds: float) -> Row:
    """A case's answer beside the truth; look-alikes that are told with a name count for it."""
    answer = json.loads((case / "answer.json").read_text())
    effects, kind = tuple(answer["effects"]), answer["kind"]
    told = {f.effect.name: {f.effect.name, *f.indistinguishable} for f in result.findings if f.effect}
    inside = kind in ("single", "pair")
    wrong = any(not inside or not alike & set(effects) for alike in told.values())
    if inside and effects:
        right = not wrong and len(told) == len(effects)
    else:
        right = not told and (result.verdict.value == "unexplained") == (kind == "outside" and bool(effects))
    error = float(result.test.error_over_noise)
    return Row(
        case.name, name, kind, effects, tuple(told), result.verdict.value, right, wrong, error, seconds
    )


def diagnosed(case: Path, name: str, limit: float) -> Row:
    """Diagnose a case by a variant."""
    rig = read_rig(case / "rig.toml")
    train = [read_recording(case / f"{one}.csv", rig) for one in TRAIN]
    held = [read_recording(case / f"{HELD_OUT}.csv", rig)]
    began = time.process_time()
    idle: dict[str, float] = {}
    with without(VARIANTS[name]) as options, recorded(idle) if name == AS_IS else nullcontext():
        result = pipeline.diagnose(rig, train, held, budget=Budget(limit), options=options)
    return replace(judged(case, name, result, round(time.process_time() - began, 1)), idle=idle)


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """What ran."""
    file = folder / "ablation.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def run(folder: Path, names: list[str], cases: int, limit: float, say: Callable[[str], None]) -> None:
    """Every case by every variant, the search as it is first; what ran is not run again."""
    done = {(row["case"], row["variant"]): row for row in rows_of(folder)}
    for case in cases_of(folder)[:cases]:
        for name in [AS_IS, *(name for name in names if name != AS_IS)]:
            if (case, name) in done:
                continue
            plain = done.get((case, AS_IS), {"idle": {}})
            if name in plain["idle"]:
                row = {
                    **plain,
                    "variant": name,
                    "seconds": plain["seconds"] - plain["idle"][name],
                    "idle": {},
                }
            else:
                row = asdict(diagnosed(folder / case, name, limit))
            done[case, name] = row
            with (folder / "ablation.jsonl").open("a") as file:
                file.write(json.dumps(row) + "\n")
            say(f"{case} {name}: {'right' if row['right'] else 'not right'}, {row['seconds']:.0f} s")


def difference(both: int, lost: int, won: int, neither: int) -> tuple[float, float, float]:
    """Share of right answers with a part less that without it, of paired cases, with its 95 % interval."""
    n, z = both + lost + won + neither, float(norm.ppf(0.975))
    p1, p2 = (both + lost) / n, (both + won) / n

    def wilson(p: float) -> tuple[float, float]:
        middle, half = p + z**2 / (2 * n), z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return (middle - half) / (1 + z**2 / n), (middle + half) / (1 + z**2 / n)

    (l1, u1), (l2, u2) = wilson(p1), wilson(p2)
    product = (both + lost) * (won + neither) * (both + won) * (lost + neither)
    phi = (both * neither - lost * won) / np.sqrt(product) if product else 0.0
    low = np.sqrt((p1 - l1) ** 2 - 2 * phi * (p1 - l1) * (u2 - p2) + (u2 - p2) ** 2)
    high = np.sqrt((u1 - p1) ** 2 - 2 * phi * (u1 - p1) * (p2 - l2) + (p2 - l2) ** 2)
    return p1 - p2, p1 - p2 - float(low), p1 - p2 + float(high)


def table(folder: Path) -> str:
    """Variants beside the search as it is, in Markdown."""
    rows = {(row["case"], row["variant"]): row for row in rows_of(folder)}
    heads = "without", "cases", "right", "lost", "won", "gain of the part (95 %)", "wrong names", "seconds"
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, variant in VARIANTS.items():
        its = {case: row for (case, who), row in rows.items() if who == name}
        pairs = [(rows[case, AS_IS], row) for case, row in its.items() if (case, AS_IS) in rows]
        if not pairs:
            continue
        met = [(a["right"], b["right"]) for a, b in pairs]
        both, lost, won, neither = (met.count((x, y)) for x in (True, False) for y in (True, False))
        gain, low, high = difference(both, lost, won, neither)
        ratio = float(np.exp(np.mean([np.log(b["seconds"] / a["seconds"]) for a, b in pairs])))
        wrong = sum(b["wrong_name"] for _, b in pairs)
        lines.append(
            f"| {variant.words} | {len(pairs)} | {both + won} | {lost} | {won} | "
            f"{100 * gain:+.0f} % ({100 * low:+.0f} to {100 * high:+.0f}) | {wrong} | x {ratio:.2f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run or tell."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("run", "table"):
        one = commands.add_parser(name)
        one.add_argument("folder", type=Path, help="an open draw")
    one = commands.choices["run"]
    one.add_argument("--only", help=f"variants, of {', '.join(VARIANTS)}; all if absent")
    one.add_argument("--cases", type=int, default=30)
    one.add_argument("--limit", type=float, default=300.0, help="processor seconds a case may take")
    asked = parser.parse_args()
    if asked.command == "table":
        print(table(asked.folder))
        return
    names = list(VARIANTS) if asked.only is None else asked.only.split(",")
    if unknown := [name for name in names if name not in VARIANTS]:
        sys.exit(f"--only: {', '.join(unknown)} is none of {', '.join(VARIANTS)}")
    run(asked.folder, names, asked.cases, asked.limit, lambda words: print(words, flush=True))


if __name__ == "__main__":
    main()
