"""Types of arrays, as all packages call them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
#: Counters and stamps.
IntArray = NDArray[np.int64]
#: What numpy indexes with.
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]
