"""Options for the structure of eq. 12 and for its estimation, shared by all commands that identify."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from optid.armax.forgetting import Forgetting

MOST_DELAY = 10_000  # samples


def numbers(context: click.Context, option: click.Parameter, value: str) -> tuple[int, ...]:
    """Read "3,4,5": whole numbers of at least 1, each once."""
    try:
        read = tuple(dict.fromkeys(int(part) for part in value.split(",")))
    except ValueError:
        read = ()
    if not read or min(read) < 1:
        raise click.BadParameter(
            f'"{value}": expected whole numbers of at least 1, as in 3,4,5', context, option
        )
    return read


def one_for_each_input(least: int) -> Callable[..., tuple[int, ...] | None]:
    """Read "3" or "3,2", one number an input, none below `least`."""

    def read(context: click.Context, option: click.Parameter, value: str | None) -> tuple[int, ...] | None:
        if value is None:
            return None
        try:
            each = tuple(int(part) for part in value.split(","))
        except ValueError:
            each = ()
        if not each or not least <= min(each) or max(each) > MOST_DELAY:
            raise click.BadParameter(
                f'"{value}": expected a whole number of at least {least}, or one for each input as in 3,2',
                context,
                option,
            )
        return each

    return read


def forgetting(context: click.Context, option: click.Parameter, value: str | None) -> Forgetting | None:
    """Read "0.998", "directional:0.99" or "variable:500" (samples of memory)."""
    from optid.armax.forgetting import Constant, Directional, Variable

    if value is None:
        return None
    kind, _, number = value.rpartition(":")
    laws: dict[str, Callable[[float], Forgetting]] = {
        "": Constant,
        "directional": Directional,
        "variable": Variable,
    }
    try:
        size = float(number)
    except ValueError:
        size = math.nan
    low, high = (1.0, 1e9) if kind == "variable" else (0.5, 1.0)
    if kind not in laws or not low <= size <= high:
        raise click.BadParameter(
            f'"{value}": expected a factor from 0.5 to 1, directional:FACTOR or variable:SAMPLES',
            context,
            option,
        )
    return laws[kind](size)


FORGETTING = click.option(
    "--forgetting",
    callback=forgetting,
    metavar="LAW",
    help="Forgetting of the recursion: 0.998, directional:0.99 or variable:500.",
)
