"""Every number that a diagnosis goes by: what counts as proof, and how much work a search does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Criteria:
    """What counts as proof.

    Attributes:
        level: rate of false names on a rig that lacks nothing, the whole catalogue together.
        error_over_noise: error of windows over the noise up to which a model is good to the noise.
        smallest_gain: share by which an effect must lower the windows' error (physics catalogue B.3, step 5).
        smallest_share: of the squared error of the plain model, what an effect beside others must explain: right laws
            follow those of the catalogue within a tenth or two of their size.
        largest_rest: share of the squared error that names may leave where a plant states none of its own: no more than
            they explain.
        most_effects: that are named together.
        fewest_windows: that a recording must hold.
        told_apart: level at which windows must prefer an effect to a look-alike for the two to be told apart.
    """

    level: float = 0.01
    error_over_noise: float = 1.2
    smallest_gain: float = 0.04
    smallest_share: float = 0.02
    largest_rest: float = 0.5
    most_effects: int = 3
    fewest_windows: int = 4
    told_apart: float = 0.05


@dataclass(frozen=True)
class SearchOptions:
    """How much a search does; it never changes what counts as proof.

    Attributes:
        rate: samples a second at most, over which is searched; what was found is fitted and tested on all.
        short: share of a window over which effects are first fitted: short enough for parameters that are far off.
        race: legs of the race of proposals, which the best branch of each effect enters: steps, and how many go on;
            over the recording that lacks most, the last leg over all.
        entrants: branches that race beside a model that is good to the noise; all of them elsewhere.
        contenders: proposals that are fitted in full in a round.
        turns, steps: of a full fit by multi-step prediction errors.
        validation_steps: of a fit without one recording.
        near: times the least loss of a start or a proposal beyond which others are not fitted in full.
        search_share: of the budget, that the search may spend; what was found is then tested and told.
    """

    rate: float = 500.0
    short: float = 0.2
    race: tuple[tuple[int, int], ...] = ((2, 4), (3, 4))
    entrants: int = 10
    contenders: int = 3
    turns: int = 4
    steps: int = 4
    validation_steps: int = 2
    near: float = 3.0
    search_share: float = 0.7
