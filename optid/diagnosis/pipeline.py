"""The diagnosis: recordings to a problem, a base fit, selection among proposals, alternatives, refinement, the test.

Each stage is a function from a frozen input to a frozen result. No stage before the test receives a sample of the
held-out recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

from optid.core.budget import UNLIMITED, Budget
from optid.core.checkpoint import Checkpoint
from optid.core.recording import Recording
from optid.diagnosis.alternatives import compare_alternatives
from optid.diagnosis.base_fit import (
    at_full_rate,
    fit_base,
    is_at_noise,
    relax_bounds,
    with_open_variance,
    with_residual_noise,
)
from optid.diagnosis.between_samples import inputs_that_go_on, straight_inputs, straightened
from optid.diagnosis.checkpoint import (
    base_document,
    base_from,
    key_of,
    path_document,
    path_from,
)
from optid.diagnosis.criteria import Criteria, SearchOptions
from optid.diagnosis.fitted import FittedModel, refit
from optid.diagnosis.localisation.unknown_input import locate
from optid.diagnosis.problem import DiagnosisProblem, Stage, measurement_noise, prepare
from optid.diagnosis.refinement import final_fit, refine, with_information
from optid.diagnosis.result import Diagnosis, Verdict
from optid.diagnosis.selection.backward import without_effects
from optid.diagnosis.selection.path import SelectionPath, nothing_selected, without_each
from optid.diagnosis.selection.stepwise import select
from optid.diagnosis.surrogate.search import Surrogate, answer_of, find_surrogate
from optid.diagnosis.surrogate.sticking_input import find_sticking_input
from optid.diagnosis.tested_result import SearchResult, TestedResult
from optid.diagnosis.testing import gate, test_on_holdout
from optid.diagnosis.validation import cross_validate
from optid.diagnosis.verdict import (
    conclude,
    gains_alone,
    is_beyond_doubt,
    is_explained_elsewhere,
    is_sufficient,
    leaves_mismatch,
)
from optid.effects.effect import Effect
from optid.errors import InputError
from optid.rigs.rigfile import Rig


def diagnose(
    rig: Rig,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    *,
    own: Sequence[Effect] = (),
    validation: Sequence[str] = (),
    progress: Callable[[float, str], None] | None = None,
    budget: Budget = UNLIMITED,
    criteria: Criteria | None = None,
    options: SearchOptions | None = None,
    checkpoint: Path | None = None,
) -> Diagnosis:
    """Find the physics that a rig's model leaves out.

    Args:
        rig: the base model; its [fit] table says what may be fitted.
        recordings: to fit and to select on; those sampled faster than 1 kHz are decimated to it first.
        holdout: to test on, once.
        own: the user's effects, in addition to the catalogue.
        validation: names of training recordings whose windows alone judge the selection, with parameters fitted to the
            others; blocks of every recording if absent.
        progress: called with the share done and a few words.
        budget: processor time and deadline of the whole.
        criteria: what counts as proof.
        options: effort of the search.
        checkpoint: file of finished stages; an interrupted diagnosis of the same inputs continues from it.

    Raises:
        InputError: no parameter to fit, no held-out recording, or one that is too short for a test.
        SolveError: the model cannot be simulated at the rig file's values.
    """
    criteria, options = criteria or Criteria(), options or SearchOptions()

    def report(stage: Stage, words: str) -> None:
        if progress is not None:
            progress(stage.share, words)

    if not rig.freed:
        raise InputError("nothing to fit", where=rig.path, field="[fit]", expected="at least one parameter")
    if not holdout:
        raise InputError("no recording is held out", where="--holdout", expected="at least one recording")
    _, sealed = prepare(rig, holdout)
    rig, train = prepare(rig, recordings)
    outputs, commands = [port.role for port in rig.model.outputs], [port.role for port in rig.model.recorded]
    gate([*train, *sealed], outputs, commands)
    problem = DiagnosisProblem(
        rig,
        train,
        measurement_noise(rig, train),
        tuple(own),
        _numbers(validation, train),
        criteria,
        options,
        budget=budget.share(options.search_share),
        report=report,
    )
    kept = Checkpoint(checkpoint, key_of(problem))
    base, search = _base_fit(problem.at_search_accuracy(), kept)
    if roles := inputs_that_go_on(base, search):
        problem = straightened(problem, roles)
        base, search = fit_base(problem.at_search_accuracy())
    problem = with_residual_noise(problem, base, search)
    path, search, wide = _select_at_either_rate(base, search, problem, kept)
    path, alternatives = compare_alternatives(path, search)
    path = replace(path, ended_early=path.ended_early or search.budget.is_over)
    surrogate = _describe_mismatch(path, search, problem) if wide is None else None
    report(Stage.REFINEMENT, "maximum likelihood and intervals")
    problem = replace(with_open_variance(problem, path.base), budget=budget)
    unseal = partial(straight_inputs, sealed, roles)
    found = SearchResult(problem, search, path, alternatives, surrogate, wide is not None)
    tested = _refine_and_test(found, wide or answer_of(path, surrogate), unseal)
    answer = _conclude_from_confirmed(tested, unseal) if tested.unconfirmed else conclude(tested)
    kept.clear()
    return answer


def _describe_mismatch(
    path: SelectionPath, search: DiagnosisProblem, problem: DiagnosisProblem
) -> Surrogate | None:
    """What is described rather than named; ``None`` where the named effects suffice, or nothing would be visible."""
    instead = find_sticking_input(path, search, problem)
    if instead is None and is_beyond_doubt(path, search):
        return None
    search.report(Stage.LOCALISATION, "locating the mismatch with an unknown input")
    sites = locate(path.base, search)
    if not sites:
        return None
    if instead is not None:
        return Surrogate(instead, tuple(sites), tuple(sites[:1]))
    found = find_surrogate(path, sites, search)
    enough = is_sufficient(path, search) and not is_explained_elsewhere(path, found, search)
    return None if enough else found


def _conclude_from_confirmed(tested: TestedResult, unseal: Callable[[], Sequence[Recording]]) -> Diagnosis:
    """The answer without names that the hold-out does not confirm, where the rest stands alone.

    A name of that answer has passed two tests on the same windows, beside the others and without them: its error rate
    is no larger than that of one. Where the rest does not stand alone, the larger answer is told with its doubts.
    """
    path = without_effects(tested.path, tested.unconfirmed, tested.search)
    if gains_alone(path, tested.search):
        found = SearchResult(*(getattr(tested, one.name) for one in fields(SearchResult)))
        alone = conclude(_refine_and_test(replace(found, path=path), path.best, unseal), doubted=tested)
        if alone.verdict is Verdict.MISSING_PHYSICS:
            return alone
    return conclude(replace(tested, confirmed=path))


def _refine_and_test(
    found: SearchResult, answer: FittedModel, unseal: Callable[[], Sequence[Recording]]
) -> TestedResult:
    """The answer of a search, refined on all samples and tested on the recordings held out."""
    path, problem = found.path, found.problem
    last = partial(final_fit, search=found.search, problem=problem)
    fitted = last(path.base)
    best = refine(fitted if answer is path.base else last(answer), problem)
    plain = best if answer is path.base else with_information(fitted)
    problem.report(Stage.TEST, "testing on the recordings held out")
    rivals = {name: last(one) if one.effects else one for name, one in without_each(path, answer).items()}
    strongest = None if path.strongest is None or best is not plain else last(path.strongest)
    opened = unseal()
    test = test_on_holdout(plain, best, rivals, strongest, opened, problem.noise, problem.criteria)
    names = tuple(one.name for one in opened)
    return TestedResult(**vars(found), base=plain, best=best, test=test, holdout=names)


def _numbers(names: Sequence[str], train: Sequence[Recording]) -> tuple[int, ...]:
    """Indices of the training recordings with these names."""
    known = [one.name for one in train]
    if unknown := [name for name in names if name not in known]:
        raise InputError(
            f'no recording "{unknown[0]}" among those to fit', where="--validate", expected=" or ".join(known)
        )
    if names and set(known) == set(names):
        raise InputError(
            "every recording to fit is also given for validation",
            where="--validate",
            expected="at least one recording that is only fitted",
        )
    return tuple(k for k, name in enumerate(known) if name in names)


def _base_fit(problem: DiagnosisProblem, kept: Checkpoint) -> tuple[FittedModel, DiagnosisProblem]:
    if (found := kept.load("base fit")) is not None:
        return base_from(found, problem)
    base, problem = fit_base(problem)
    kept.save("base fit", base_document(base, problem))
    return base, problem


def _select_at_either_rate(
    base: FittedModel, search: DiagnosisProblem, problem: DiagnosisProblem, kept: Checkpoint
) -> tuple[SelectionPath, DiagnosisProblem, FittedModel | None]:
    """The path of the selection, its problem, and the base with wider bounds if these explain everything.

    Decimated recordings are searched at their own rate where that alone brings the base to the noise. A search that
    leaves a mismatch goes on at that rate, if it selected nothing or that rate alone takes its selection nearer to the
    noise.
    """
    full = at_full_rate(base, search, problem)
    if full is not None and is_at_noise(*full):
        base, search = full
    if (wide := relax_bounds(base, search)) is not None:
        return nothing_selected(base, search), search, wide
    path = _selection(base, search, kept)
    if full is not None and leaves_mismatch(path, search):
        begun = refit(path.best, full[1])
        left = cross_validate(begun, full[1]).error_over_noise / path.validated.error_over_noise
        if not path.best.effects or left < 1.0 - search.criteria.smallest_gain:
            again = _selection(*full, kept, "selection at the full rate", begun)
            if again.best.effects:
                return replace(again, earlier=path.rounds), full[1], None
    return path, search, None


def _selection(
    base: FittedModel,
    problem: DiagnosisProblem,
    kept: Checkpoint,
    stage: str = "selection",
    begun: FittedModel | None = None,
) -> SelectionPath:
    if (found := kept.load(stage)) is not None:
        return path_from(found, problem)
    path = select(base, problem, begun)
    if not path.ended_early:
        kept.save(stage, path_document(path))
    return path
