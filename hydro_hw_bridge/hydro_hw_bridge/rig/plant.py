"""The truth plant: rigid bodies, cylinders, valves and oil, integrated at a fixed fine step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig import kernel
from hydro_hw_bridge.rig.extras import CYLINDER_FIELDS, JOINT_FIELDS, AxisExtras
from hydro_hw_bridge.rig.kernel_bodies import equations_of_motion
from hydro_hw_bridge.rig.kernel_frames import move_frames
from hydro_hw_bridge.rig.kernel_records import CYLINDER, FRAME, LINK, WORLD
from hydro_hw_bridge.rig.payload import loaded
from hydro_hw_bridge.rig.process import Process
from hydro_hw_bridge.rig.truth import CylinderTruth, LinkTruth, Truth, ValveTruth
from hydro_model.robot import Cylinder, FloatArray, Joint, Robot

Records = NDArray[Any]

#: Integration step: well inside the stability limit of the classical Runge-Kutta method for the
#: stiffest part, a small chamber behind a fully open valve.
STEP_S = 50.0e-6
#: Plays that a hysteresis consists of.
PLAYS = 5
#: Pressure of the lower chamber at the start, as a share of the supply.
RESTING_SHARE = 0.2


class Plant:
    """State and motion of one machine.

    Parameters
    ----------
    robot : Robot
        Geometry, n joints and m cylinders.
    truth : Truth
    q : (n,) array
        Initial joint positions, rad or m.

    Attributes
    ----------
    state : (2 n + 5 m + 2,) array
        q, qd, pressures of the chambers A, of the chambers B, bristle deflections, spool
        positions, spool speeds, supply and tank pressure; pressures gauge. With extras, behind
        them: bend of every mount (m,), angle and rate of every sprung load (n,) each, and of
        every cylinder pressure at the valve and flow of hose A, then of hose B, (m,) each.

    Raises
    ------
    BridgeError
        The pose lies outside a cylinder's stroke, or no pressure holds it.
    """

    def __init__(self, robot: Robot, truth: Truth, q: FloatArray) -> None:
        n, m = robot.dof, len(robot.cylinders)
        self.robot = robot
        self.truth = truth
        self._links = _links(robot, truth)
        self._cylinders = _cylinders(robot, truth)
        self._world = _world(robot, truth)
        self._frames = np.zeros(n + 1, dtype=FRAME)
        self._frames[0]["rotation"] = np.eye(3)
        self._jac, self._matrix, self._bias = np.zeros((3, n, 3)), np.zeros((n, n)), np.zeros(n)
        self._lines = 2 * n + 5 * m
        self._extra = truth.extras.in_plant
        self.state = np.zeros(self._lines + 2 + (m + 2 * n + 4 * m) * self._extra)
        # Three rows for the integrator, one for what the spools are asked.
        self._work = np.zeros((4, self.state.size))
        self.state[:n] = q
        lines = truth.supply.pressure_pa, truth.supply.tank_pressure_pa
        self.state[self._lines : self._lines + 2] = lines
        self._rest()
        if self._extra:
            self._rest_extras()
        self._memory = np.zeros((m, PLAYS))
        self._older = np.zeros(m)
        self._process = Process(truth.extras.machine, m, 1.0 / robot.sensors.rate_hz)
        # No steps: compiles before the clock runs.
        kernel.advance(self.state, np.zeros(m), True, 0, STEP_S, *self.records, self._work)

    @property
    def records(self) -> tuple[NDArray[Any], ...]:
        """Arguments of every kernel: links, frames, cylinders, world, and three scratch arrays."""
        return (
            self._links,
            self._frames,
            self._cylinders,
            self._world,
            self._jac,
            self._matrix,
            self._bias,
        )

    @property
    def q(self) -> FloatArray:
        """Joint positions (n,), rad or m: a view."""
        return self.state[: self.robot.dof]

    @property
    def qd(self) -> FloatArray:
        """Joint rates (n,): a view."""
        return self.state[self.robot.dof : 2 * self.robot.dof]

    def _block(self, index: int) -> FloatArray:
        m = len(self.robot.cylinders)
        start = 2 * self.robot.dof + index * m
        return self.state[start : start + m]

    @property
    def pressures_a(self) -> FloatArray:
        """Gauge pressures of the bore-side chambers (m,), Pa: a view."""
        return self._block(0)

    @property
    def pressures_b(self) -> FloatArray:
        """Gauge pressures of the rod-side chambers (m,), Pa: a view."""
        return self._block(1)

    @property
    def spools(self) -> FloatArray:
        """Spool positions by cylinder (m,), in [-1, 1]: a view."""
        return self._block(3)

    @property
    def lines_index(self) -> int:
        """Where supply and tank pressure stand in the state."""
        return self._lines

    @property
    def supply_pa(self) -> float:
        """Gauge pressure of the supply line."""
        return float(self.state[self._lines])

    @property
    def tank_pa(self) -> float:
        """Gauge pressure of the tank line."""
        return float(self.state[self._lines + 1])

    def advance(
        self, asked: FloatArray, duration_s: float, *, pump: bool = True, step_s: float = STEP_S
    ) -> None:
        """Move on with the spool positions asked for by cylinder (m,) held.

        Parameters
        ----------
        asked : (m,) array
            Normalised spool positions, by cylinder.
        duration_s : float
        pump : bool
        step_s : float
            Longest integration step; the duration is divided evenly.

        Raises
        ------
        BridgeError
            The state left the finite numbers.
        """
        steps = max(1, int(np.ceil(duration_s / step_s - 1e-9)))
        step = duration_s / steps
        if self._extra:
            self._cycle(np.asarray(asked, dtype=float), duration_s, pump, steps)
        else:
            kernel.advance(self.state, asked, pump, steps, step, *self.records, self._work)
        if not np.isfinite(self.state).all():
            raise BridgeError(f"plant of {self.robot.name}: the state is no longer finite")

    def _cycle(self, asked: FloatArray, duration_s: float, pump: bool, steps: int) -> None:
        """One cycle with extras: disturbance, delayed command, hysteresis."""
        push, shake = self._process.draw(1)
        self._cylinders["disturbance"], self._cylinders["shake"] = push[0], shake[0]
        share = min(self.truth.extras.machine.command_delay_s / duration_s, 1.0)
        out = np.zeros_like(asked)
        kernel.cycle(
            self.state,
            self._older,
            asked,
            share,
            self._memory,
            pump,
            steps,
            duration_s,
            self._work,
            *self.records,
            out,
        )
        self._older = asked.copy()

    def load_tip(self, mass_kg: float) -> None:
        """Fix a point mass to the tip, in place of the one before; 0 takes it away.

        Positions and velocities go on as they are: the load is taken at the tip's own speed.
        """
        link = loaded(self.truth.links[-1], mass_kg, self.robot.tip_offset_m)
        _fill_link(self._links[-1], link)

    def rates(self, asked: FloatArray, *, pump: bool = True) -> FloatArray:
        """Time derivative of the whole state, in its layout.

        `asked` (m,) are the normalised spool positions that the amplifiers ask for; `pump` is
        False while it is off.
        """
        out = np.zeros_like(self.state)
        kernel.rates(self.state, asked, pump, *self.records, out)
        return out

    def strokes(self) -> FloatArray:
        """Piston displacements (m,), m."""
        equations_of_motion(self.q, self.qd, *self.records)
        return np.array(self._cylinders["x"])

    def tip(self) -> FloatArray:
        """Tip position and velocity in the base frame (6,), m and m/s."""
        move_frames(self.q, self.qd, self._links, self._frames)
        last = self._frames[-1]
        arm = last["rotation"] @ self.robot.tip_offset_m
        velocity = last["velocity"] + np.cross(last["spin"], arm)
        return np.concatenate([last["origin"] + arm, velocity])

    def equations(
        self, q: FloatArray, qd: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mass matrix (n, n), bias (n,) with gravity, and levers dx/dq (m,) at a state."""
        equations_of_motion(np.asarray(q), np.asarray(qd), *self.records)
        lower = np.tril(self._matrix)
        matrix = lower + np.tril(lower, -1).T
        return matrix, self._bias.copy(), np.array(self._cylinders["lever"])

    def _rest_extras(self) -> None:
        """Mounts bent and hoses filled as the resting chambers ask for."""
        n, m = self.robot.dof, len(self.robot.cylinders)
        mounts, hoses = self._lines + 2, self._lines + 2 + m + 2 * n
        record = self._cylinders
        force = self.pressures_a * record["area_a"] - self.pressures_b * record["area_b"]
        stiff = record["mount_stiffness"] > 0.0
        bend = force / np.where(stiff, record["mount_stiffness"], 1.0)
        bend += np.sign(force) * record["mount_gap"]
        self.state[mounts : mounts + m] = np.where(stiff, bend, 0.0)
        self.state[hoses : hoses + m] = self.pressures_a
        self.state[hoses + 2 * m : hoses + 3 * m] = self.pressures_b

    def _rest(self) -> None:
        """Chamber pressures that hold the pose against gravity."""
        _, bias, lever = self.equations(self.q, np.zeros(self.robot.dof))
        pose = np.array2string(self.q, precision=3)
        for i, cylinder in enumerate(self.robot.cylinders):
            record = self._cylinders[i]
            if not 0.0 <= record["x"] <= cylinder.stroke_m:
                raise BridgeError(
                    f"pose {pose} puts '{cylinder.name}' at {record['x']:.3f} m,"
                    f" outside its stroke 0 to {cylinder.stroke_m} m"
                )
            force = bias[record["joint"]] / lever[i]
            low = RESTING_SHARE * self.supply_pa
            # Both chambers at or above the resting pressure, the loaded one above it.
            p_a = max(low, (force + low * record["area_b"]) / record["area_a"])
            p_b = (p_a * record["area_a"] - force) / record["area_b"]
            if max(p_a, p_b) > self.supply_pa:
                raise BridgeError(
                    f"pose {pose}: '{cylinder.name}' needs {force:.0f} N,"
                    f" more than {self.supply_pa / 1e6:.1f} MPa of supply holds"
                )
            self.pressures_a[i], self.pressures_b[i] = p_a, p_b


def _links(robot: Robot, truth: Truth) -> Records:
    out = np.zeros(robot.dof, dtype=LINK)
    driven = {c.joint for c in robot.cylinders}
    for row, joint, link in zip(out, robot.joints, truth.links, strict=True):
        turn = np.zeros((3, 3)) if joint.prismatic else np.cross(np.eye(3), joint.axis)
        # Rodrigues: exp(q K) = 1 + sin q K + (1 - cos q) K^2.
        row["turn_0"] = joint.rotation
        row["turn_sin"] = joint.rotation @ turn
        row["turn_cos"] = joint.rotation @ turn @ turn
        row["offset"] = joint.translation_m
        row["axis"] = joint.rotation @ joint.axis
        row["prismatic"] = joint.prismatic
        row["stopped"] = joint.name not in driven
        row["lower"], row["upper"] = joint.lower, joint.upper
        _fill_link(row, link)
    for cylinder, axis in zip(robot.cylinders, truth.extras.axes, strict=False):
        for name in JOINT_FIELDS:
            out[robot.joint_index(cylinder.joint)][name] = getattr(axis, name)
    return out


def _fill_link(row: Any, link: LinkTruth) -> None:
    row["mass"], row["com"] = link.mass_kg, link.com_m
    row["inertia"] = link.inertia_com_kg_m2


def _cylinders(robot: Robot, truth: Truth) -> Records:
    out = np.zeros(len(robot.cylinders), dtype=CYLINDER)
    by_cylinder = {v.cylinder: t for v, t in zip(robot.valves, truth.valves, strict=True)}
    closed = ValveTruth("none", 0.0, 0.0, 0.0, 0.0)
    for row, cylinder, real in zip(out, robot.cylinders, truth.cylinders, strict=True):
        index = robot.joint_index(cylinder.joint)
        row["joint"] = index
        row["direct"] = cylinder.l1_m == 0.0
        if row["direct"] and (real.barrel is not None or real.rod is not None):
            raise BridgeError(
                f"truth {truth.name}: '{cylinder.name}' is on a prismatic joint: expected its"
                " barrel and rod in the links that they move with, found parts of its own"
            )
        row["parent_pin"], row["child_pin"] = _pins(cylinder, robot.joints[index])
        row["closed_length"], row["full_stroke"] = cylinder.x0_m, cylinder.stroke_m
        row["area_a"], row["area_b"] = cylinder.area_a_m2, cylinder.area_b_m2
        _fill_cylinder(row, real)
        _fill_valve(row, by_cylinder.get(cylinder.name, closed))
    for row, axis in zip(out, _axes(robot, truth), strict=True):
        row["extra"] = truth.extras.in_plant
        for name in CYLINDER_FIELDS:
            row[name] = getattr(axis, name)
    return out


def _axes(robot: Robot, truth: Truth) -> tuple[AxisExtras, ...]:
    axes = truth.extras.axes or (AxisExtras(),) * len(robot.cylinders)
    if len(axes) != len(robot.cylinders):
        raise BridgeError(
            f"truth {truth.name}: expected extras of {len(robot.cylinders)} cylinders,"
            f" found {len(axes)}"
        )
    return axes


def _fill_cylinder(row: Any, real: CylinderTruth) -> None:
    for name, part in (("barrel", real.barrel), ("rod", real.rod)):
        if part is not None:
            row[name] = part.mass_kg, part.com_from_pin_m, part.inertia_com_kg_m2
            row["heavy"] = 1
    row["dead_a"], row["dead_b"] = real.dead_volume_a_m3, real.dead_volume_b_m3
    row["leak"] = real.internal_leakage
    row["leak_a"], row["leak_b"] = real.external_leakage_a, real.external_leakage_b
    row["viscous"], row["coulomb"] = real.viscous_friction, real.coulomb_friction_n
    row["static"] = real.static_friction_n
    row["stribeck_velocity"] = real.stribeck_velocity_m_s
    if real.coulomb_friction_n > 0.0:
        row["bristle"] = real.coulomb_friction_n / real.bristle_deflection_m
    row["bristle_damping"] = real.bristle_damping


def _fill_valve(row: Any, valve: ValveTruth) -> None:
    row["c_pa"], row["c_at"], row["c_pb"], row["c_bt"] = (
        valve.c_pa,
        valve.c_at,
        valve.c_pb,
        valve.c_bt,
    )
    row["deadband"], row["rounding"] = valve.deadband, valve.deadband_rounding
    row["null"] = valve.null_bias
    row["spool_rate"] = 2.0 * np.pi * valve.natural_frequency_hz
    row["spool_damping"], row["spool_limit"] = valve.damping_ratio, valve.rate_limit_1_s
    row["transition"] = valve.transition_pressure_pa


def _world(robot: Robot, truth: Truth) -> Records:
    out = np.zeros(1, dtype=WORLD)
    fluid, supply = truth.fluid, truth.supply
    out["gravity"] = robot.gravity_m_s2 if truth.gravity_m_s2 is None else truth.gravity_m_s2
    out["tip"] = robot.tip_offset_m
    out["extra"] = truth.extras.in_plant
    for name in ("contact_stiffness", "contact_height", "contact_damping"):
        out[name] = getattr(truth.extras.machine, name)
    out["supply_ripple"] = truth.extras.machine.supply_ripple
    out["supply_ripple_rate"] = truth.extras.machine.supply_ripple_rate
    out["bulk_modulus"] = fluid.bulk_modulus_pa
    out["low_pressure_loss"] = fluid.low_pressure_loss
    out["low_pressure_scale"] = fluid.low_pressure_scale_pa
    out["atmosphere"] = robot.atmospheric_pressure_pa
    out["supply"], out["tank"] = supply.pressure_pa, supply.tank_pressure_pa
    out["droop"], out["droop_quadratic"] = supply.droop, supply.droop_quadratic
    out["droop_lag"] = supply.droop_lag_s
    out["tank_resistance"], out["tank_lag"] = supply.tank_resistance, supply.tank_lag_s
    return out


def _pins(cylinder: Cylinder, joint: Joint) -> tuple[FloatArray, FloatArray]:
    """Pins in the frames of the links before and after the joint."""
    if cylinder.l1_m == 0.0:
        return np.zeros(3), np.zeros(3)
    axis = np.asarray(joint.axis, dtype=float)
    # Angles count from the child frame's x axis as seen along the joint axis; from its y axis
    # where that is x but for rounding or a calibration: 0.01 rad.
    along = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
    if float(along @ along) < 0.01**2:
        along = np.array([0.0, 1.0, 0.0]) - axis[1] * axis
    along /= np.sqrt(along @ along)
    across = np.cross(axis, along)
    child_angle = cylinder.child_pin_angle_rad
    # x(q) is shortest at q + q0 = 0: there the two pins lie in one direction.
    parent_angle = child_angle - cylinder.q0_rad
    child = cylinder.l2_m * (np.cos(child_angle) * along + np.sin(child_angle) * across)
    parent = cylinder.l1_m * (np.cos(parent_angle) * along + np.sin(parent_angle) * across)
    return joint.translation_m + joint.rotation @ parent, child
