"""Compiled barrels and rods of cylinders: bodies whose angle follows from their joint's.

A part is a slender body hinged at its own pin of a host (barrel: on the link before the joint,
rod: on the link behind it) and aligned with the other pin. With the pins `own` and `other` from
the joint axis and ``a = q + q0`` the angle between them, its line in the host's frame is

``e = ((other cos a - own) U + other sin a W) / L``, ``L^2 = own^2 + other^2 - 2 own other cos a``

with U towards the own pin and ``W = Z x U``; Z is the joint axis for a barrel and its opposite for
a rod. It turns about Z, relative to the host, at ``r(q) qd`` with
``r = (other^2 - own other cos a) / L^2``. Its force at the pin and moment about it are

``F = m A + h e''``, ``N = e x (h A + I e'')``

with A the pin's acceleration less gravity, and mass m, first moment h along the line, transverse
inertia I about the pin. Own arguments, besides those of
`hydro_model.multibody.rigid_body_kernels`:

- `parts` (k, PART_COLUMNS): a row per barrel and rod, made by
  `hydro_model.multibody.closed_chain`;
- `scratch` has a row per part behind those of the n links.
"""

from __future__ import annotations

import math

from hydro_model.multibody.chain_kernels import (
    ACC,
    BODY,
    COLUMN,
    FORCE,
    REQ,
    VEL,
    Array,
    add_wrench_to_parent,
    on_axis,
)
from hydro_model.multibody.closed_chain import (
    ANGLE,
    FIRST,
    HOST,
    JOINT,
    MASS,
    OTHER,
    OWN,
    PART_SIZE,
    PIN,
    SECOND,
    U,
    W,
    Z,
)
from hydro_model.numerics.kernel import kernel
from hydro_model.numerics.triple_kernels import Triple, cross, dot, plus, triple

# Columns of a part's row of the working memory: its line e, r and dr/dq, the pin's acceleration
# A and e''.
_LINE, _RATE, _SLOPE, _PIN_ACC, _LINE_ACC = 0, 3, 4, 5, 8


@kernel
def place_parts(q: Array, parts: Array, scratch: Array) -> None:
    """Line, r and dr/dq of every part at `q`, into the working memory."""
    for i in range(parts.shape[0]):
        row = q.shape[0] + i
        angle = q[int(parts[i, JOINT])] + parts[i, ANGLE]
        own, other = parts[i, OWN], parts[i, OTHER]
        cosine, sine = math.cos(angle), math.sin(angle)
        square = own * own + other * other - 2.0 * own * other * cosine
        length = math.sqrt(square)
        along, across = (other * cosine - own) / length, other * sine / length
        for k in range(3):
            scratch[row, _LINE + k] = along * parts[i, U + k] + across * parts[i, W + k]
        scratch[row, _RATE] = (other * other - own * other * cosine) / square
        slope = own * other * sine * (own * own - other * other)
        scratch[row, _SLOPE] = slope / (square * square)


@kernel
def move_parts(
    qd: Array, qd_r: Array, qdd_r: Array, gravity: Array, parts: Array, scratch: Array
) -> None:
    """Accelerations of every part, after `move`; required ones with the measured velocities.

    As for links: derivatives are of the required velocity's components in the part's frame,
    which turns with the measured one.
    """
    still = (0.0, 0.0, 0.0)
    for i in range(parts.shape[0]):
        row, host, joint = qd.shape[0] + i, int(parts[i, HOST]), int(parts[i, JOINT])
        w, v, w_r, v_r, dw = still, still, still, still, still
        dv = (-gravity[0], -gravity[1], -gravity[2])
        if host >= 0:
            w, v = triple(scratch, host, VEL), triple(scratch, host, VEL + 3)
            w_r, v_r = triple(scratch, host, REQ), triple(scratch, host, REQ + 3)
            dw, dv = triple(scratch, host, ACC), triple(scratch, host, ACC + 3)
        pin, z, e = triple(parts, i, PIN), triple(parts, i, Z), triple(scratch, row, _LINE)
        rate, slope = scratch[row, _RATE], scratch[row, _SLOPE]
        turn = rate * qd[joint]
        # Pin: u = v + w x pin; then d/dt of the required u, seen from the part, plus w x u.
        u, u_r = plus(v, 1.0, cross(w, pin)), plus(v_r, 1.0, cross(w_r, pin))
        w = plus(w, turn, z)
        acc = plus(dv, 1.0, cross(dw, pin))
        acc = plus(plus(acc, turn, cross(u_r, z)), 1.0, cross(w, u))
        spin = rate * qdd_r[joint] + slope * qd[joint] * qd_r[joint]
        dw = plus(plus(dw, spin, z), turn, cross(w_r, z))
        line = plus(cross(dw, e), 1.0, cross(w, cross(w, e)))
        for k in range(3):
            scratch[row, _PIN_ACC + k] = acc[k]
            scratch[row, _LINE_ACC + k] = line[k]


@kernel
def _wrench_on_host(
    i: int, force: Triple, moment: Triple, column: int, parts: Array, scratch: Array
) -> None:
    """A force at part i's pin and a moment about it added to those of the host's frame."""
    host = int(parts[i, HOST])
    if host < 0:
        return
    about = plus(moment, 1.0, cross(triple(parts, i, PIN), force))
    for k in range(3):
        scratch[host, column + k] += about[k]
        scratch[host, column + 3 + k] += force[k]


@kernel
def add_part_forces(parts: Array, scratch: Array, out: Array) -> None:
    """Forces of all parts: onto their hosts, and what turning them takes added to `out` (n,)."""
    for i in range(parts.shape[0]):
        row = out.shape[0] + i
        m, h, inertia = parts[i, MASS], parts[i, FIRST], parts[i, SECOND]
        acc, line = triple(scratch, row, _PIN_ACC), triple(scratch, row, _LINE_ACC)
        e, z = triple(scratch, row, _LINE), triple(parts, i, Z)
        force = (m * acc[0] + h * line[0], m * acc[1] + h * line[1], m * acc[2] + h * line[2])
        moment = cross(
            e,
            (
                h * acc[0] + inertia * line[0],
                h * acc[1] + inertia * line[1],
                h * acc[2] + inertia * line[2],
            ),
        )
        out[int(parts[i, JOINT])] += scratch[row, _RATE] * dot(z, moment)
        _wrench_on_host(i, force, moment, FORCE, parts, scratch)


@kernel
def carry_inwards(
    link: int, column: int, axis: Array, prismatic: Array, scratch: Array, out: Array
) -> None:
    """Add the force in COLUMN of `link` to column `column` of `out`, joint by joint inwards."""
    for j in range(link, -1, -1):
        part = 3 if prismatic[j] else 0
        out[j, column] += on_axis(scratch, j, COLUMN, axis, j, part)
        if j > 0:
            for k in range(6):
                scratch[j - 1, COLUMN + k] = 0.0
            add_wrench_to_parent(scratch, j, COLUMN)


@kernel
def part_regressor(
    axis: Array, prismatic: Array, parts: Array, scratch: Array, out: Array
) -> None:
    """Columns of the parts' parameters into those of `out` behind the links', after moving."""
    n = out.shape[0]
    still = (0.0, 0.0, 0.0)
    for i in range(parts.shape[0]):
        row, host, joint = n + i, int(parts[i, HOST]), int(parts[i, JOINT])
        acc, line = triple(scratch, row, _PIN_ACC), triple(scratch, row, _LINE_ACC)
        e, z = triple(scratch, row, _LINE), triple(parts, i, Z)
        for p in range(PART_SIZE):
            column = 10 * n + PART_SIZE * i + p
            for j in range(n):
                out[j, column] = 0.0
            force, moment = acc, still
            if p == 1:
                force, moment = line, cross(e, acc)
            elif p == 2:
                force, moment = still, cross(e, line)
            out[joint, column] = scratch[row, _RATE] * dot(z, moment)
            if host >= 0:
                for k in range(6):
                    scratch[host, COLUMN + k] = 0.0
                _wrench_on_host(i, force, moment, COLUMN, parts, scratch)
                carry_inwards(host, column, axis, prismatic, scratch, out)


@kernel
def add_part_bodies(n: int, parts: Array, scratch: Array) -> None:
    """Inertia of the parts, as they lie, added to the composite bodies of their hosts.

    With the second moment ``S = m p p^T + h (p e^T + e p^T) + I e e^T`` about the host's
    origin, the inertia is ``tr(S) 1 - S``.

    `n` is the number of links.
    """
    for i in range(parts.shape[0]):
        host = int(parts[i, HOST])
        if host < 0:
            continue
        m, h, inertia = parts[i, MASS], parts[i, FIRST], parts[i, SECOND]
        p, e = triple(parts, i, PIN), triple(scratch, n + i, _LINE)
        first = plus((m * p[0], m * p[1], m * p[2]), h, e)
        trace = dot(p, first) + h * dot(p, e) + inertia * dot(e, e)
        b, at = BODY, BODY + 4
        scratch[host, b] += m
        for r in range(3):
            scratch[host, b + 1 + r] += first[r]
            for c in range(r, 3):
                moment = p[r] * first[c] + e[r] * (h * p[c] + inertia * e[c])
                scratch[host, at] += (trace if r == c else 0.0) - moment
                at += 1


@kernel
def add_part_rates(
    axis: Array, prismatic: Array, parts: Array, scratch: Array, mass: Array
) -> None:
    """What the parts' turning against their hosts adds to the mass matrix (n, n)."""
    n = mass.shape[0]
    for i in range(parts.shape[0]):
        host, joint, rate = int(parts[i, HOST]), int(parts[i, JOINT]), scratch[n + i, _RATE]
        mass[joint, joint] += rate * rate * parts[i, SECOND]
        if host < 0:
            continue
        z, e = triple(parts, i, Z), triple(scratch, n + i, _LINE)
        push = rate * parts[i, FIRST]
        spin = rate * parts[i, SECOND]
        across = cross(z, e)
        for k in range(6):
            scratch[host, COLUMN + k] = 0.0
        force = (push * across[0], push * across[1], push * across[2])
        moment = (spin * z[0], spin * z[1], spin * z[2])
        _wrench_on_host(i, force, moment, COLUMN, parts, scratch)
        # Once as the row and once as the column of the joint.
        for j in range(host, -1, -1):
            value = on_axis(scratch, j, COLUMN, axis, j, 3 if prismatic[j] else 0)
            mass[j, joint] += value
            mass[joint, j] += value
            if j > 0:
                for k in range(6):
                    scratch[j - 1, COLUMN + k] = 0.0
                add_wrench_to_parent(scratch, j, COLUMN)


@kernel
def part_moment(n: int, i: int, parts: Array, scratch: Array) -> tuple[float, float, float, float]:
    """Mass and first moment of part i in its host's frame, after `place_parts`.

    `n` is the number of links.
    """
    p, e = triple(parts, i, PIN), triple(scratch, n + i, _LINE)
    m, h = parts[i, MASS], parts[i, FIRST]
    return m, m * p[0] + h * e[0], m * p[1] + h * e[1], m * p[2] + h * e[2]
