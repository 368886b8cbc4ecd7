"""What recordings can be used for, and the next step, in one line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from optid.core.recording import Recording
from optid.quality.remark import Remark

# The remedy for each kind of remark; the first that occurs, in this order, is the next step.
_NEXT = {
    "polarity": "correct the sign, in the rig file or at the terminals",
    "reach": "correct the offset, the unit or the stroke in the rig file",
    "jump": "cut the file at the jump",
    "still": "record again with more motion",
    "missing": "record again, or use another recording",
    "feedback": "record again with a moving reference or a test signal on the command",
    "tied": "record again with inputs that move at different times",
    "lag": "align the channels in time",
    "jitter": "give the rate instead of the time column, if the samples were taken evenly",
    "slow": "sample faster",
    "outliers": "leave the outliers out, or fit with --robust",
    "excitation": "add a recording that moves both ways and at several speeds",
    "beyond_scale": "check the full scale in the rig file",
    "clipped": "check the sensor's range",
    "stuck": "check the sensor",
    "quantised": "use a finer sensor if the fit is not good enough",
}
_NO_EVEN_GRID = {"jitter", "slow"}  # a discrete-time model needs even, dense samples
_NO_INPUT = {"feedback", "tied"}


@dataclass(frozen=True)
class Verdict:
    """What recordings can be used for.

    Attributes:
        fit_for: commands that can use them: "simulate", "identify", "fit", "diagnose"; possibly none.
        why_not: command -> why it is not among them.
        next: what to do, in words.
    """

    fit_for: tuple[str, ...]
    why_not: dict[str, str]
    next: str

    @property
    def sentence(self) -> str:
        """The last line of a check."""
        what = f"usable for {', '.join(self.fit_for)}" if self.fit_for else "unfit"
        grouped: dict[str, list[str]] = {}
        for command, why in self.why_not.items():
            grouped.setdefault(why, []).append(command)
        reasons = "; ".join(f"not for {', '.join(commands)}: {why}" for why, commands in grouped.items())
        return f"{what}{f' ({reasons})' if reasons else ''}. Next: {self.next}"


def verdict(
    read: Sequence[tuple[Recording, Sequence[Remark]]], idle: Sequence[str], freed: Sequence[str], call: str
) -> Verdict:
    """Weigh the remarks on recordings.

    Args:
        read: recordings with their remarks.
        idle: parameters to fit that have no influence on them.
        freed: parameters to fit.
        call: the rig file and the recordings, as a command line takes them.
    """
    remarks = [remark for _, several in read for remark in several]
    kinds = {remark.kind for remark in remarks if remark.severity != "note"}
    grave = next((remark for remark in remarks if remark.severity == "error"), None)
    why: dict[str, str] = {}
    if grave is not None:
        what = f"{grave.channel} ({grave.kind})"
        # A black-box model identifies either sign and any zero; a plant with its own cannot.
        blind = () if grave.kind in ("polarity", "reach") else ("identify",)
        why |= dict.fromkeys((*blind, "fit", "diagnose"), what)
    elif idle:
        why |= dict.fromkeys(("fit", "diagnose"), f"no influence of {', '.join(idle)}")
    elif not freed:
        why |= dict.fromkeys(("fit", "diagnose"), "the rig file's [fit] table is empty")
    uneven = kinds & _NO_EVEN_GRID or kinds & _NO_INPUT
    if uneven and "identify" not in why:
        why["identify"] = f"{min(uneven)} (above)"
    fit_for = tuple(command for command in ("simulate", "identify", "fit", "diagnose") if command not in why)
    if grave is not None and grave.kind in ("missing", "still"):
        fit_for, why = (), {}
    return Verdict(fit_for, why, _next(kinds, idle, freed, fit_for, call))


def _next(
    kinds: set[str], idle: Sequence[str], freed: Sequence[str], fit_for: Sequence[str], call: str
) -> str:
    cure = next((words for kind, words in _NEXT.items() if kind in kinds), None)
    if "fit" in fit_for:
        return f"optid fit {call} --out DIR" + (f" (better, first {cure})" if cure else "")
    if idle:
        return f"take {', '.join(idle)} out of [fit], or record motion that shows them"
    if not freed and cure is None:
        return f"optid simulate {call} --out DIR, or list the parameters to fit in [fit]"
    return cure or f"optid simulate {call} --out DIR"
