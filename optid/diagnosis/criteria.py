"""All numbers of a diagnosis: what counts as proof, and how much work a search does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Criteria:
    """What counts as proof.

    Attributes:
        level: rate of false effects on a rig that lacks nothing, for the whole catalogue together; and of each other
            test, as of an effect against a look-alike.
        error_over_noise: error of windows over the noise up to which a model counts as at the noise.
        smallest_gain: share by which an effect must lower the windows' error.
        smallest_share: share of the plain model's squared error that an effect must explain in addition to others:
            true laws follow those of the catalogue within a tenth or two of their size.
        largest_rest: share of the squared error that named effects may leave where the plant states none: what remains
            may be other physics, and is told. Right laws were seen to leave 57 %, a wrong one 97 %.
        most_effects: largest number of effects that are named together.
    """

    level: float = 0.01
    error_over_noise: float = 1.2
    smallest_gain: float = 0.04
    smallest_share: float = 0.02
    largest_rest: float = 0.67
    most_effects: int = 3


@dataclass(frozen=True)
class SearchOptions:
    """The effort of a search; it never changes what counts as proof.

    Attributes:
        rate: largest sampling rate of the search; its result is fitted and tested at full rate.
        tolerance: local error of its integration, as a share of each state's usual size; its result is fitted and
            tested more accurately.
        short: share of a window over which effects are fitted first: short enough for parameters that are far off.
        proposal_steps: Gauss-Newton steps of every proposal over short windows, of which the contenders are the best.
        contenders: proposals that are fully fitted in a round.
        turns, steps: of a full fit by multi-step prediction errors.
        near: multiple of the smallest loss beyond which other starts or proposals are not fully fitted.
        search_share: share of the budget for the search; the rest is for testing and reporting.
    """

    rate: float = 500.0
    tolerance: float = 1e-4
    short: float = 0.2
    proposal_steps: int = 3
    contenders: int = 3
    turns: int = 4
    steps: int = 4
    near: float = 3.0
    search_share: float = 0.7
