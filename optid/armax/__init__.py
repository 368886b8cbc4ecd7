"""ARMAX models of eq. 12: recursive and offline identification, prediction, comparison, checks, export."""

from optid.armax.forgetting import Constant, Directional, Variable
from optid.armax.identifier import Identifier, Method, Settings
from optid.armax.model import Armax, from_transfer_function
from optid.armax.offline import Identification, exact_start, identify
from optid.armax.structure import Orders

__all__ = [
    "Armax",
    "Constant",
    "Directional",
    "Identification",
    "Identifier",
    "Method",
    "Orders",
    "Settings",
    "Variable",
    "exact_start",
    "from_transfer_function",
    "identify",
]
