"""How the loops of this package are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from optid.core.jit_cache import kept

Kernel = TypeVar("Kernel", bound=Callable[..., object])
# No fused or reordered arithmetic: a traced loop is bit-identical to the exported controller.
compiled: Callable[[Kernel], Kernel] = kept(error_model="numpy", nogil=True)
