"""What the integrators of the model share: working memory and the right-hand side, scaled.

States are scaled by `ModelArrays.scale`, so that radians and pascals are of one size in the linear
algebra and in the error norms.

Arguments shared by these kernels: `model`, `work`, `solver`: a `ModelArrays`, `Work` and `Solver`;
`time` in s; `inputs`: what `Model.inputs` gives, held over the step; `y`: state in SI units, `z`
scaled, `dz` its rate; `h`: length of the step, s; `mode`: what is asked for, such as `RATES`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hydro_model.arrays import IntArray
from hydro_model.numerics.dormand_prince import STAGES
from hydro_model.numerics.kernel import inlined
from hydro_model.robot import FloatArray
from hydro_model.simulation.simulate_kernels import right_hand_side

Array = Any  # numba types the kernels; mypy follows no numba import

FIRST_STEP_S = 1.0e-4
#: Steps that are kept of what is looked ahead to.
PIECES = 32


class Ahead(NamedTuple):
    """What was looked ahead to of c states that follow from the commands alone, scaled."""

    now: FloatArray  # (c,)
    new: FloatArray  # (c,)
    stages: FloatArray  # (STAGES, c)
    pieces: FloatArray  # (PIECES, 5, c) polynomials of steps
    ends: FloatArray  # (PIECES + 1,) where they end, after where the first begins, s
    kept: IntArray  # (1,) number of those steps
    first: FloatArray  # (1,) length to try first after a change of command, s


class Solver(NamedTuple):
    """Working memory of the integration for a state of s entries."""

    z: FloatArray  # (s,) scaled state
    new: FloatArray  # (s,) scaled state after the step
    y: FloatArray  # (s,) state
    f: FloatArray  # (s,) scaled right-hand side at z
    column: FloatArray  # (s,)
    k: FloatArray  # (STAGES, s) of the formula with the most
    jacobian: FloatArray  # (s, s)
    matrix: FloatArray  # (s, s)
    pivot: IntArray  # (s,)
    tried: IntArray  # (1,) steps
    speed: FloatArray  # (1,) the fastest rate that the latest explicit step saw, 1/s
    ahead: Ahead
    stiff: IntArray  # (2,) explicit steps that were held short, implicit ones still to be made


def new_solver(size: int, known: int) -> Solver:
    """Working memory for `size` states, of which `known` follow from the commands alone."""
    z, new, y, f, column = np.zeros((5, size))
    return Solver(
        z=z,
        new=new,
        y=y,
        f=f,
        column=column,
        k=np.zeros((STAGES, size)),
        jacobian=np.zeros((size, size)),
        matrix=np.zeros((size, size)),
        pivot=np.zeros(size, dtype=np.int64),
        tried=np.zeros(1, dtype=np.int64),
        speed=np.zeros(1),
        ahead=Ahead(
            now=np.zeros(known),
            new=np.zeros(known),
            stages=np.zeros((STAGES, known)),
            pieces=np.zeros((PIECES, 5, known)),
            ends=np.zeros(PIECES + 1),
            kept=np.zeros(1, dtype=np.int64),
            first=np.full(1, FIRST_STEP_S),
        ),
        stiff=np.zeros(2, dtype=np.int64),
    )


@inlined
def scaled_rates(
    model: Any,
    work: Any,
    time: float,
    inputs: Array,
    z: Array,
    dz: Array,
    y: Array,
    mode: int,
) -> bool:
    """Right-hand side of the scaled state `z` into `dz`; False where it fails."""
    for i in range(z.shape[0]):
        y[i] = z[i] * model.scale[i]
    good: bool = right_hand_side(model, work, time, inputs, y, dz, mode)
    for i in range(z.shape[0]):
        dz[i] /= model.scale[i]
    return good
