"""How the recursion's functions are compiled by numba.

Numba's cache looks at the file of the outermost function alone: who changes a function that others call has to
touch `recursion.py` too (or delete `__pycache__`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])
_OPTIONS = {"cache": True, "error_model": "numpy", "nogil": True}
# Without reference counts on the parts of the array: they would cost three times the arithmetic.
compiled: Callable[[Kernel], Kernel] = numba.njit(_nrt=False, **_OPTIONS)
folded: Callable[[Kernel], Kernel] = numba.njit(_nrt=False, inline="always", **_OPTIONS)
