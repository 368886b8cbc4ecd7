"""What the paper prints in section 6: transfer functions, gains and Table 2, restored.

Source: "Identification and Analysis of Servo-Pneumatic System using Mixed Reality Environment", section 6.
The rows of Table 2 are scrambled in the extracted text; they are given here as they belong together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from optid.armax.loop import Gains
from optid.armax.model import Armax, from_transfer_function

if TYPE_CHECKING:
    import pandas as pd

SAMPLE_TIME: Final = 1e-3  # s; the paper names only its card's 250 kS/s, so this is an assumption
GAINS: Final = Gains(kp=16.0, ki=6.0, kd=0.001)  # section 6, after Table 2; units not printed

# (order, steps): numerator and denominator in powers of z, section 6.1 and 6.2. That of five steps is lost.
TRANSFER_FUNCTIONS: Final = {
    (3, 1): ((1.557, 0.4883, 0.020353), (1.0, 0.32635, 0.055097, 0.01184)),
    (4, 1): ((1.5265, 1.2318, 1.1036, -0.0030112), (1.0, 0.82665, 0.77581, 0.041607, 0.027019)),
    (5, 1): (
        (1.5317, -2.8807, 1.4205, -0.074304, -0.0049132),
        (1.0, -1.8633, 0.93297, -0.10507, 0.032798, -0.00267),
    ),
    (4, 10): ((1.5084, -0.1845, -0.98753, -0.043927), (1.0, -0.10416, -0.62197, -0.046606, -0.023213)),
}


@dataclass(frozen=True)
class Printed:
    """One row of Table 2, cm; NaN is not printed, or not to be told from the extracted text."""

    order: int
    steps: int
    signal: str
    square_error: float
    sd: float
    max: float
    min: float
    remark: str = ""


_NAN = float("nan")
_SCATTER = "square error / sd^2 = 3.98: neither the mean square (1) nor eq. 13 over the record"
TABLE_2: Final = (
    Printed(3, 1, "real", _NAN, 1.037, 14.64, -0.007084),
    Printed(3, 1, "predicted", _NAN, 1.037, 14.64, -0.004885),
    Printed(3, 1, "error", 9.34e-6, 0.001532, 0.007137, -0.007972, _SCATTER),
    Printed(4, 1, "real", _NAN, 1.031, 14.56, -0.005816),
    Printed(4, 1, "predicted", _NAN, 1.031, 14.56, -0.009149, "the row's minimum may be the error's"),
    Printed(4, 1, "error", 9.29e-6, 0.001527, 0.005538, -0.009141, _SCATTER + "; maximum elsewhere 0.005549"),
    Printed(5, 1, "real", _NAN, 1.02, 14.4, -0.01974, "the two minima of the fifth order may be exchanged"),
    Printed(5, 1, "predicted", _NAN, 1.02, 14.4, _NAN),
    Printed(5, 1, "error", 2.14e-5, 0.00232, 0.01243, -0.01976, _SCATTER),
    Printed(
        4, 5, "error", 3.31e-5, 0.001716, _NAN, _NAN,
        "square error / sd^2 = 11.2, all others have 3.98: repeats the ten-step value; 1.17e-5 would fit",
    ),
    Printed(4, 10, "error", 3.31e-5, 0.002884, _NAN, _NAN, _SCATTER),
)  # fmt: skip


def published(order: int, steps: int = 1, sample_time: float = SAMPLE_TIME) -> Armax:
    """A transfer function of section 6 as a model."""
    return from_transfer_function(TRANSFER_FUNCTIONS[order, steps], sample_time)


def printed_table() -> pd.DataFrame:
    """Table 2 as printed, with what does not agree."""
    import pandas as pd

    rows = [vars(row) for row in TABLE_2]
    frame = pd.DataFrame(rows).set_index(["order", "steps", "signal"])
    frame.insert(1, "square_error_over_sd2", frame["square_error"] / frame["sd"] ** 2)
    return frame
