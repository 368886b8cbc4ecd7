"""Identified ARMAX models, in the form of armax.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from optid.armax.files import ArmaxFile, from_document
from optid.armax.model import Armax
from optid.results.result import Result

if TYPE_CHECKING:
    import control
    import pandas as pd

TABLE2 = "table2.csv"
EXPORTS = ("armax_model.h", "armax_identifier.h", "armax_model.st", "armax_identifier.st")


class IdentificationResult(Result):
    """ARMAX models of several orders with their checks, and which one is recommended.

    `files["table2.csv"]`: errors of their predictions, as in the paper's Table 2.
    """

    FILE: ClassVar[str] = "armax.json"
    SCHEMA: ClassVar[str] = "optid.armax/1"
    FILES: ClassVar[tuple[str, ...]] = (TABLE2, "report.html", *EXPORTS)

    @property
    def contents(self) -> ArmaxFile:
        """The document as models; `contents.chosen` is the recommended one."""
        return from_document(dict(self.document))

    @property
    def model(self) -> Armax:
        """The recommended model."""
        return self.contents.chosen

    def to_control(self, order: int | None = None) -> control.StateSpace:
        """A model as a discrete state space of python-control, with named signals.

        Parameters
        ----------
        order : int | None
            na of the model; the recommended one when absent.

        Returns
        -------
        control.StateSpace
            a state space with named signals.

        Raises
        ------
        StopIteration
            no model of that order.
        """
        contents = self.contents
        model = next(m.model for m in contents.models if m.model.orders.na == (order or contents.recommended))
        system = model.state_space()
        system.name = f"armax_{model.orders.na}"
        system.set_inputs([name.strip() for name in contents.input.split(",")] or None)
        system.set_outputs([contents.output or "y"])
        return system

    def summary(self) -> str:
        """The recommended model and why, and the alarms of each model.

        Returns
        -------
        str
            a few lines.
        """
        contents = self.contents
        lines = [f"{contents.output} from {contents.input}: {contents.words}"]
        lines.append(f"order {contents.recommended}: {contents.chosen}")
        for saved in contents.models:
            grave = [finding.text for finding in saved.audit if finding.grave]
            lines.append(f"order {saved.model.orders.na}: {'no alarm' if not grave else ''}".rstrip())
            lines += [f"  ! {text}" for text in grave]
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """One row per coefficient: order, name, value and standard error.

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        import pandas as pd

        rows = []
        for saved in self.contents.models:
            model = saved.model
            names = [*(f"a{k}" for k in range(1, len(model.a)))]
            names += [
                f"b{i or ''}_{nk + k}"
                for i, (b, nk) in enumerate(zip(model.b, model.nk, strict=True))
                for k in range(len(b))
            ]
            names += [f"c{k}" for k in range(1, len(model.c))]
            rows += [
                (model.orders.na, *row) for row in zip(names, model.theta, model.standard_errors, strict=True)
            ]
        return pd.DataFrame(rows, columns=["order", "coefficient", "value", "standard_error"])
