"""How the truth plant's code is compiled.

Functions of one module may be copied into those of another: the folder that compiled code is kept
in (`hydro_model.compile_cache`) is another one after a change of any file of this package.
"""

from __future__ import annotations

from numba import njit

#: Decorator of functions that are called from Python, or too large to be copied.
compiled = njit(cache=True, error_model="numpy")
#: The same for those that are copied into each of their callers.
inlined = njit(cache=True, error_model="numpy", forceinline=True)
