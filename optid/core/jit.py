"""Compile a model: its equations by LLVM when first asked for, bound to the kernel that every model shares."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import llvmlite.binding as llvm

from optid.core import kernel
from optid.core.cache import sources, stored
from optid.core.llvm_codegen import source, source_of_lanes, source_of_runs, width
from optid.core.model import Model
from optid.core.threads import one_at_a_time

_COMPILING = threading.Lock()


@dataclass(frozen=True, eq=False)
class Compiled:
    """A model's functions in machine code, with slopes to `directions` start states and parameters.

    Attributes:
        code: where the functions are, for the kernel.
        directions: states and free parameters; rows of slopes are padded to `width`.
        engine: owns the machine code.
    """

    code: kernel.Code
    directions: int
    width: int
    engine: Any = field(repr=False)

    def run(self, function: Callable[..., None], *arguments: Any) -> None:
        """Call a kernel with this code, which is kept in memory until it returns; addresses alone would not keep it.

        Args:
            function: one of `optid.core.kernel`, `optid.core.ddf2` or `optid.core.gauss_newton_kernels`.
            arguments: its own, after the code.
        """
        function(self.code, *arguments)


@lru_cache(maxsize=64)
def compiled(model: Model, free: tuple[int, ...] = ()) -> Compiled:
    """The machine code of a model, with slopes to the states and to the `free` parameters.

    A model that was never compiled on this machine takes a fraction of a second.
    """
    return _bound(f"slopes {free}", model, lambda: source(model, free), len(model.states) + len(free))


@lru_cache(maxsize=128)
def compiled_runs(model: Model) -> Compiled:
    """The machine code of a model for runs without slopes, for models of which many are tried."""
    return _bound("runs", model, lambda: source_of_runs(model), len(model.states))


@lru_cache(maxsize=128)
def compiled_lanes(model: Model) -> Compiled:
    """As `compiled_runs`, for the filter and its kin, which move several states at once."""
    return _bound("lanes", model, lambda: source_of_lanes(model), len(model.states))


@one_at_a_time
def _bound(kind: str, model: Model, write: Callable[[], str], directions: int) -> Compiled:
    equations = [f.serialize() for f in (model.rates, model.sensors, model.halves) if f is not None]
    engine = machine_code(" ".join([kind, *equations]), write)
    names = (name for name in kernel.Code._fields if name != "hoisted")
    places = {
        name: engine.get_function_address(name) for name in names
    }  # 0 for a function that does not exist
    hoisted = ctypes.CFUNCTYPE(ctypes.c_double)(engine.get_function_address("hoisted"))()
    return Compiled(kernel.Code(**places, hoisted=int(hoisted)), directions, width(directions), engine)


def machine_code(content: str, write: Callable[[], str]) -> Any:
    """An engine that owns the machine code of LLVM's intermediate code and knows its functions' addresses.

    `content` is what the code depends on: `write` is asked for the code where no run has compiled that before.
    """
    machine = _machine()
    host = f"{llvm.llvm_version_info} {machine.triple} {llvm.get_host_cpu_name()} {_features()}"
    with (
        _COMPILING
    ):  # LLVM compiles one at a time anyway, and a thread that waited for the same model finds it stored
        code = stored(f"{host} {sources(__file__)} {content}", lambda: object_code(write()))
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def object_code(text: str) -> bytes:
    """Compile LLVM's intermediate code for the processor this runs on."""
    machine = _machine()
    module = llvm.parse_assembly(text)
    module.triple = machine.triple
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    code: bytes = machine.emit_object(module)
    return code


def _machine() -> Any:
    """The processor this runs on, with all it can do; one per model, whose engine owns it."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=2, jit=True
    )


def _features() -> str:
    features: str = llvm.get_host_cpu_features().flatten()
    return features
