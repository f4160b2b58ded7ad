"""How the package's numba kernels are compiled.

Kernels get all memory from their caller and return numbers. So they need not count references to
arrays, which numba does with atomic instructions at every view and every call: about 1000 of them
in one right-hand side of the model, most of its time. (numba's `_nrt` switches its runtime for
allocation off; a kernel that allocates then fails to compile.)
"""

from __future__ import annotations

from typing import Any

from numba import njit

from hydro_model.numerics.compile_notice import announce_compilation

announce_compilation()

#: Decorator of kernels that allocate nothing and return no arrays.
kernel = njit(cache=True, error_model="numpy", _nrt=False)
#: The same for one that is copied into its callers: a call that passes a model costs as much as
#: a hundred multiplications.
inlined = njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
#: The same for one that is large and has one caller: put into it before it is compiled. A kernel
#: is compiled with all that it calls, so that each of a chain of four would compile all again.
merged = njit(cache=True, error_model="numpy", _nrt=False, inline="always")


@kernel
def copy(source: Any, target: Any) -> None:
    """Entries of one vector into another; quicker to compile than an assignment to a slice.

    Both are arrays of one shape; `source` is copied into `target`.
    """
    for i in range(source.shape[0]):
        target[i] = source[i]
