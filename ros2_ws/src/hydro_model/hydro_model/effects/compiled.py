"""Laws compiled: called by address, so that one cached kernel serves every set of effects.

A kernel specialised to a set of effects would be compiled anew for each set. Here the kernels call
laws through their addresses. The catalogue's are compiled (and cached) as one piece of code: what
numba compiles on its own begins a memory page of its own, and at the same place of so many pages
laws drive each other from the processor's instruction cache. Any other law is compiled alone.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import cfunc, types
from numba.extending import intrinsic

from hydro_model.effects import signals as names
from hydro_model.effects.law import Law
from hydro_model.numerics.kernel import kernel
from hydro_model.robot import FloatArray

_POINTER = types.CPointer(types.float64)
_SIGNATURE = types.float64(_POINTER, _POINTER)


def _catalogue_laws() -> tuple[Law, ...]:
    """Every law of the catalogue, once."""
    from hydro_model.effects.catalogue import CATALOGUE

    found: dict[Law, None] = {}
    for effect in CATALOGUE.values():
        found |= dict.fromkeys(term.law for term in effect.terms)
        for state in effect.states:
            found |= dict.fromkeys((state.rate, state.initial))
            found |= dict.fromkeys([state.after] if state.after else [])
    return tuple(found)


@intrinsic
def _store_addresses(typing_context: Any, out: Any) -> Any:
    """Compile the catalogue's laws into the calling kernel's code, their addresses into `out`.

    `typing_context` is numba's own.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        double, word = ir.DoubleType(), ir.IntType(64)
        kind = ir.FunctionType(double, [double.as_pointer(), double.as_pointer()])
        target = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        for i, law in enumerate(_catalogue_laws()):
            compiled = context.compile_subroutine(builder, law, _SIGNATURE)
            function = ir.Function(builder.module, kind, name=f"hydro_law_{i}")
            function.linkage = "internal"
            body = ir.IRBuilder(function.append_basic_block())
            _, value = context.call_internal_no_propagate(
                body, compiled.fndesc, _SIGNATURE, function.args
            )
            body.ret(value)
            address = builder.ptrtoint(function, word)
            builder.store(address, builder.gep(target, [ir.Constant(word, i)]))
        return context.get_dummy_value()

    return types.none(out), generate


@kernel
def _addresses(out: Any) -> None:
    _store_addresses(out)


@cache
def _table() -> dict[Law, int]:
    laws = _catalogue_laws()
    out = np.zeros(len(laws), dtype=np.int64)
    _addresses(out)
    return dict(zip(laws, out.tolist(), strict=True))


@cache
def _compiled(law: Law) -> Any:
    return cfunc(_SIGNATURE, cache=True, error_model="numpy")(law)


def law_address(law: Law) -> int:
    """Address of a law compiled as ``double law(const double *s, const double *p)``."""
    return _table().get(law) or int(_compiled(law).address)


@cache
def signals_read(law: Law) -> frozenset[int]:
    """Indices of the signals that a law looks at, of `hydro_model.effects.signals`."""
    used = law.__code__.co_names
    return frozenset(getattr(names, name) for name in used if name.lower() in names.SIGNAL_NAMES)


@intrinsic
def call_law(typing_context: Any, address: Any, signals: Any, parameters: Any) -> Any:
    """Call a law by its address with two contiguous float64 arrays, from compiled code.

    `signals` and `parameters` are the arrays, `typing_context` is numba's own.
    """
    signature = types.float64(types.int64, signals, parameters)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        function = ir.FunctionType(double, [double.as_pointer(), double.as_pointer()])
        target = builder.inttoptr(arguments[0], function.as_pointer())
        data = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(signature.args[1:], arguments[1:], strict=True)
        ]
        return builder.call(target, data)

    return signature, generate


@kernel
def _evaluate(address: int, signals: FloatArray, parameters: FloatArray, out: FloatArray) -> None:
    for k in range(signals.shape[0]):
        out[k] = call_law(address, signals[k], parameters)


def evaluate_law(law: Law, signals: FloatArray, parameters: FloatArray) -> FloatArray:
    """A law row by row: (N, SIGNAL_COUNT) signals to (N,) values.

    `parameters` are in the order of the effect's.
    """
    out = np.empty(len(signals))
    _evaluate(law_address(law), signals, parameters, out)
    return out
