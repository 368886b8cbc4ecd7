"""How the recursion's functions are compiled by numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numba

from optid.core.jit_cache import kept

Kernel = TypeVar("Kernel", bound=Callable[..., object])
_OPTIONS = {"error_model": "numpy", "nogil": True}
# Without reference counts on the parts of the array: they would cost three times the arithmetic.
jit: Callable[[Kernel], Kernel] = kept(_nrt=False, **_OPTIONS)
inline_jit: Callable[[Kernel], Kernel] = numba.njit(_nrt=False, inline="always", **_OPTIONS)
