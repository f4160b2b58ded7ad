"""Compiled loops over stacks of samples around `hydro_model.multibody.rigid_body_kernels`.

Arguments are those of the kernels, stacked over samples.
"""

from __future__ import annotations

import math

from hydro_model.multibody import rigid_body_kernels as kernels
from hydro_model.multibody.chain_kernels import SHIFT, Array
from hydro_model.multibody.closed_chain import HOST
from hydro_model.multibody.part_kernels import part_moment, place_parts
from hydro_model.numerics.kernel import kernel
from hydro_model.numerics.linear_kernels import solve_spd


@kernel
def torques(
    q: Array,
    qd: Array,
    qd_r: Array,
    qdd_r: Array,
    k_v: float,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Required torques of N samples into `out` (N, n).

    `k_v` as of `rigid_body.required_torque`.
    """
    for k in range(q.shape[0]):
        kernels.required_torque_kernel(
            q[k],
            qd[k],
            qd_r[k],
            qdd_r[k],
            k_v,
            rotation,
            translation,
            axis,
            prismatic,
            gravity,
            theta,
            parts,
            scratch,
            out[k],
        )


@kernel
def regressors(
    q: Array,
    qd: Array,
    qdd: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    parts: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Regressors of N samples into `out` (N, n, 10 n + 3 k), k parts."""
    for k in range(q.shape[0]):
        kernels.regressor_kernel(
            q[k],
            qd[k],
            qdd[k],
            rotation,
            translation,
            axis,
            prismatic,
            gravity,
            parts,
            scratch,
            out[k],
        )


@kernel
def masses(
    q: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Mass matrices of N samples into `out` (N, n, n)."""
    for k in range(q.shape[0]):
        kernels.mass_matrix_kernel(
            q[k], rotation, translation, axis, prismatic, theta, parts, scratch, out[k]
        )


@kernel
def _finite(values: Array) -> bool:
    good = True
    for i in range(values.shape[0]):
        good = good and math.isfinite(values[i])
    return good


@kernel
def accelerations(
    q: Array,
    qd: Array,
    tau: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    mass: Array,
    bias: Array,
    out: Array,
) -> int:
    """Accelerations into `out` (N, n); the first sample that has none, or -1.

    `mass` (n, n) and `bias` (n,) are working memory.
    """
    n = q.shape[1]
    for k in range(q.shape[0]):
        kernels.mass_matrix_and_bias(
            q[k],
            qd[k],
            rotation,
            translation,
            axis,
            prismatic,
            gravity,
            theta,
            parts,
            scratch,
            mass,
            bias,
        )
        for i in range(n):
            out[k, i] = tau[k, i] - bias[i]
        if not (solve_spd(mass, out[k]) and _finite(out[k])):
            return k
    return -1


@kernel
def potentials(
    q: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Potential energies of N samples into `out` (N,)."""
    n = q.shape[1]
    for k in range(q.shape[0]):
        kernels.place(q[k], rotation, translation, axis, prismatic, scratch)
        place_parts(q[k], parts, scratch)
        # First moment of all that hangs on frame i, carried inwards: m, m c.
        m, h0, h1, h2 = 0.0, 0.0, 0.0, 0.0
        for i in range(n - 1, -2, -1):
            for p in range(parts.shape[0]):
                if parts[p, HOST] == i:
                    dm, d0, d1, d2 = part_moment(n, p, parts, scratch)
                    m, h0, h1, h2 = m + dm, h0 + d0, h1 + d1, h2 + d2
            if i < 0:
                break
            m += theta[i, 0]
            x, y, z = h0 + theta[i, 1], h1 + theta[i, 2], h2 + theta[i, 3]
            s = scratch[i]
            h0 = s[0] * x + s[1] * y + s[2] * z + m * s[SHIFT]
            h1 = s[3] * x + s[4] * y + s[5] * z + m * s[SHIFT + 1]
            h2 = s[6] * x + s[7] * y + s[8] * z + m * s[SHIFT + 2]
        out[k] = -(gravity[0] * h0 + gravity[1] * h1 + gravity[2] * h2)
