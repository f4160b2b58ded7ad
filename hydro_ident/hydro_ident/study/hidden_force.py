"""Effects that show in the force balance, as the truth plant has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_hw_bridge.rig.payload import Payload
from hydro_ident.study.hidden import (
    LOAD_N,
    PRESSURE_PA,
    RATE_RAD_S,
    SPEED_M_S,
    Hidden,
    Machine,
    Scene,
    axis,
    cylinder,
    has_lever,
    machine_extras,
    sign,
    with_truth,
)
from hydro_model.robot import CylinderPart

Random = np.random.Generator
_MOUNT_DAMPING = 5.0e6
_MOUNT_STIFFNESS = 5.0e9
#: Load at which a pin surely lies on one side, and turns of it that a play is hidden beside.
_LYING_N, _LEAST_TURNS = 500.0, 5
#: What v^1.75 is beyond a line through 0, over what v^2 is beyond one: rms over speeds from 0 to
#: where both are equal.
_CURVED = 0.843


def _coulomb(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return _bristle(m, i, size, r.uniform(2.0e-5, 5.0e-5))


def _presliding(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return _bristle(m, i, size, r.uniform(1.5e-4, 6.0e-4))


def _bristle(m: Machine, i: int, size: float, deflection: float) -> Machine:
    return cylinder(
        m,
        i,
        coulomb_friction_n=size,
        static_friction_n=size,
        bristle_deflection_m=deflection,
        bristle_damping=size / 0.02,
    )


def _stribeck(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    speed = r.uniform(5.0e-3, 2.0e-2)
    return axis(m, i, slow_force=size * (1.0 + (5.0e-3 / speed) ** 2), slow_velocity=speed)


def _asymmetric(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    size *= sign(r)
    if r.random() < 0.5:
        return axis(m, i, even_force=size)
    return axis(m, i, even_viscous=size / SPEED_M_S)


def _seal(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, seal=size / (1.7 * PRESSURE_PA))


def _turbulent(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, turbulent=size / (_CURVED * s.fast_m_s(i) ** 1.75))


def _local(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    low, high = np.percentile(s.stroke_m[:, i], [15.0, 85.0])
    center, width = r.uniform(low, high), r.uniform(0.25, 0.45) * (high - low)
    return axis(m, i, local_force=size, local_center=center, local_width=width)


def _pin(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    lever = float(np.median(np.abs(s.lever[:, i])))
    return axis(m, i, pin_radius=size * lever / LOAD_N)


def _warming(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    time = r.uniform(0.4, 1.5) * s.duration_s
    lost = size / SPEED_M_S / (1.0 - np.exp(-s.duration_s / time))
    thick = m.truth.cylinders[i].viscous_friction + lost
    return cylinder(
        axis(m, i, cooling=float(lost), cooling_time=float(time)), i, viscous_friction=thick
    )


def _load(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return replace(m, payload=Payload(size, float(r.uniform(0.35, 0.65)) * s.duration_s))


def _bodies(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    stroke = m.robot.cylinders[i].stroke_m
    share = r.uniform(0.55, 0.7)
    barrel = CylinderPart(share * size, 0.6 * stroke, 0.15 * share * size * stroke**2)
    rod = CylinderPart((1 - share) * size, 0.6 * stroke, 0.15 * (1 - share) * size * stroke**2)
    return cylinder(m, i, barrel=barrel, rod=rod)


def _flexible(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    joint = m.robot.joint_index(m.robot.cylinders[i].joint)
    rate = 2.0 * np.pi * r.uniform(3.0, 9.0)
    return axis(
        m,
        i,
        flex_inertia=float(size * s.inertia[joint]),
        flex_rate=float(rate),
        flex_damping=float(r.uniform(0.02, 0.08)),
    )


def _play(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(
        m,
        i,
        mount_gap=0.5 * size,
        mount_stiffness=_MOUNT_STIFFNESS * m.robot.cylinders[i].area_a_m2 / 5.0e-3,
        mount_damping=_MOUNT_DAMPING,
    )


def _load_turns(m: Machine, s: Scene, i: int) -> bool:
    """Whether a cylinder's load changes its side often enough to cross a play."""
    c = m.robot.cylinders[i]
    force = s.pressure_a[:, i] * c.area_a_m2 - s.pressure_b[:, i] * c.area_b_m2
    side = np.sign(force[np.abs(force) > _LYING_N])
    return int(np.count_nonzero(np.diff(side))) >= _LEAST_TURNS


def _tilted(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    angle = size * sign(r)
    x, y, z = m.robot.gravity_m_s2
    turned = (x * np.cos(angle) + z * np.sin(angle), y, z * np.cos(angle) - x * np.sin(angle))
    return with_truth(m, gravity_m_s2=np.array(turned))


def _offset(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, offset_force=size * sign(r))


def _spring(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, gas_force=size)


def _coupled(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    lever = float(np.median(np.abs(s.lever[:, i])))
    own = m.robot.joint_index(m.robot.cylinders[i].joint)
    others = [j for j in range(m.robot.dof) if j != own]
    torque = size * lever / RATE_RAD_S * np.hypot(1.0, RATE_RAD_S)
    return axis(m, i, coupling=float(torque), coupling_joint=float(r.choice(others)))


def _ground(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    height = float(np.percentile(s.tip_height_m, r.uniform(10.0, 25.0)))
    depth = max(height - float(s.tip_height_m.min()), 0.02)
    return machine_extras(m, contact_height=height, contact_stiffness=size / depth**1.5)


def _unlisted_bodies(machine: Machine, index: int) -> bool:
    """The file given knows of no barrel and rod anywhere."""
    listed = any(c.barrel is not None for c in machine.robot.cylinders)
    return not listed and has_lever(machine, index)


def _several(machine: Machine, index: int) -> bool:
    return machine.robot.dof > 1


FORCE_EFFECTS = (
    Hidden("coulomb_friction", 150.0, 6.0e3, "N", "sliding at 50 mm/s", _coulomb),
    Hidden("stribeck_friction", 80.0, 4.0e3, "N", "beyond sliding, at 5 mm/s", _stribeck),
    Hidden("asymmetric_friction", 60.0, 3.0e3, "N", "even part at 50 mm/s", _asymmetric),
    Hidden("pressure_dependent_friction", 50.0, 4.0e3, "N", "5 MPa in both chambers", _seal),
    Hidden("presliding_friction", 200.0, 6.0e3, "N", "sliding at 50 mm/s", _presliding),
    Hidden("quadratic_friction", 50.0, 6.0e3, "N", "as curved, at the fast speed", _turbulent),
    Hidden("position_dependent_friction", 100.0, 6.0e3, "N", "where it is largest", _local),
    Hidden("pin_friction", 50.0, 4.0e3, "N", "20 kN of load, median lever", _pin, needs=has_lever),
    Hidden("temperature_drift", 30.0, 1.2e3, "N", "change over the run at 50 mm/s", _warming),
    Hidden("payload_change", 2.0, 150.0, "kg", "at the tip", _load, "robot"),
    Hidden(
        "cylinder_inertia", 5.0, 200.0, "kg", "barrel and rod", _bodies, needs=_unlisted_bodies
    ),
    Hidden(
        "structural_flexibility", 0.01, 0.5, "1", "share of the inertia about the joint", _flexible
    ),
    Hidden("backlash", 2.0e-5, 2.0e-3, "m", "whole play", _play, linear=False, shows=_load_turns),
    Hidden("base_tilt", 5.0e-4, 0.08, "rad", "about the joints' axis", _tilted, "robot"),
    Hidden("constant_force_offset", 60.0, 4.0e3, "N", "anywhere", _offset),
    Hidden("counterbalance_spring", 200.0, 1.5e4, "N", "rod in", _spring),
    Hidden("joint_coupling", 50.0, 4.0e3, "N", "0.3 rad/s of the other", _coupled, needs=_several),
    Hidden("external_contact", 100.0, 6.0e3, "N", "lowest point of the path", _ground, "robot"),
)
