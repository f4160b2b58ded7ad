"""How the truth plant's code is compiled.

Functions of one module may be copied into those of another: the folder that compiled code is kept
in (`hydro_model.numerics.compile_cache`) is another one after a change of any file of this
package.

Most get all memory from their caller and so need not count references to arrays, which numba does
with atomic instructions at every view and every call: a third of the plant's time. (numba's
`_nrt` switches its runtime for allocation off; a function that allocates then fails to compile.)
"""

from __future__ import annotations

from numba import njit

#: Decorator of functions that are called from Python, or too large to be copied.
compiled = njit(cache=True, error_model="numpy", _nrt=False)
#: The same for those that are copied into each of their callers.
inlined = njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
#: The same for those that allocate.
allocating = njit(cache=True, error_model="numpy")
