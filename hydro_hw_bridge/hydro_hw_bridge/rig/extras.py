"""What a simulated machine may have beyond friction, dead band and leakage: plain records.

Everything here is zero by default, and a machine without extras runs through none of the code
that reads them. The forms are the rig's own: smooth signs by ``v / sqrt(v^2 + v0^2)``, turbulent
friction with Blasius' exponent, hysteresis as a sum of plays, hoses with inertia and volume.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields


@dataclass(frozen=True, slots=True)
class AxisExtras:
    """Extras of one cylinder, its valve and its joint. Forces act at the piston, against motion.

    Attributes
    ----------
    sign_velocity : float
        v0 of the smooth sign s(v), m/s.
    slow_force, slow_velocity : float
        ``F s(v) / (1 + (v / slow_velocity)^2)``, N: friction that speed takes away.
    even_force, even_viscous : float
        ``F s(v)^2`` and ``b v s(v)``, N and N s/m: directions that differ.
    seal : float
        ``seal (p_a + 0.7 p_b) s(v)``, N/Pa.
    turbulent : float
        ``c |v|^1.75 s(v)``, N (s/m)^1.75.
    local_force, local_center, local_width : float
        ``F exp(-((x - center) / width)^2) s(v)``, N and m.
    pin_radius : float
        ``pin_radius |F| s(v) / |lever|`` with the oil's force F, m (friction times radius).
    offset_force : float
        N, pulls the piston in.
    cooling, cooling_time : float
        ``-cooling (1 - exp(-t / time)) v``: viscous friction that warming takes away, N s/m, s.
    gas_force : float
        ``F (1 + x / S)^-1.3``, N, a gas spring that pushes the piston out.
    coupling, coupling_joint : float
        Torque ``-coupling w / sqrt(1 + w^2)`` with the rate w of another joint (its index),
        N m s/rad.
    mount_stiffness, mount_gap, mount_damping : float
        Spring between rod and pin (0: rigid), half its play, and its damper where it lies on,
        N/m, m, N s/m.
    flex_inertia, flex_rate, flex_damping : float
        Part of the load's inertia about the joint that hangs on a spring, kg m^2; its natural
        frequency rad/s; damping ratio.
    underlap : float
        Both edges open by this at null; an edge ``w +- u`` shuts over worn rims of 0.3 w.
    bend : float
        Opening ``u (1 + k) / (1 + k |u|)``: above 0 saturating, below progressive.
    hysteresis : float
        Mean half width of the plays between command and spool, normalised.
    compensation, compensation_pressure : float
        Share to which inflow ignores the load, and the drop at which it changes nothing, Pa.
    balance_flow, balance_pressure, balance_range, balance_ratio : float
        Load-holding valve in the outflow of chamber A: coefficient m^3/(s sqrt(Pa)) (0: none),
        opening pressure, range over which it opens (Pa) and pilot ratio.
    cushion_length, cushion_share : float
        Distance from a stop within which outflow is throttled, m, and the share left at it.
    line_inertance, line_loss, line_volume : float
        Hoses between valve and chambers: Pa s^2/m^3 (0: none), Pa s/m^3 against the widening
        of the wall, m^3.
    drag_force, drag_rate : float
        Friction that comes and goes with time, N, and its angular frequency, rad/s.
    vibration_force, vibration_rate : float
        Force ``F sin(w t)``, N, rad/s.
    ripple_torque, ripple_count, ripple_phase : float
        Torque ``a cos(count q + phase)`` of a bearing, N m, 1/rad.
    stiffness_ripple, stiffness_count : float
        The oil's stiffness times ``1 + a cos(count x)``, 1/m.
    hum, hum_rate : float
        Spool motion ``a sin(w t)`` that nobody asked for, normalised, rad/s.
    """

    sign_velocity: float = 1.0e-3
    slow_force: float = 0.0
    slow_velocity: float = 0.01
    even_force: float = 0.0
    even_viscous: float = 0.0
    seal: float = 0.0
    turbulent: float = 0.0
    local_force: float = 0.0
    local_center: float = 0.0
    local_width: float = 0.1
    pin_radius: float = 0.0
    offset_force: float = 0.0
    cooling: float = 0.0
    cooling_time: float = 30.0
    gas_force: float = 0.0
    coupling: float = 0.0
    coupling_joint: float = 0.0
    mount_stiffness: float = 0.0
    mount_gap: float = 0.0
    mount_damping: float = 1.0e6
    flex_inertia: float = 0.0
    flex_rate: float = 30.0
    flex_damping: float = 0.03
    underlap: float = 0.0
    bend: float = 0.0
    hysteresis: float = 0.0
    compensation: float = 0.0
    compensation_pressure: float = 3.5e6
    balance_flow: float = 0.0
    balance_pressure: float = 5.0e6
    balance_range: float = 2.0e6
    balance_ratio: float = 3.0
    cushion_length: float = 0.0
    cushion_share: float = 1.0
    line_inertance: float = 0.0
    line_loss: float = 0.0
    line_volume: float = 1.0e-4
    drag_force: float = 0.0
    drag_rate: float = 0.0
    vibration_force: float = 0.0
    vibration_rate: float = 0.0
    ripple_torque: float = 0.0
    ripple_count: float = 0.0
    ripple_phase: float = 0.0
    stiffness_ripple: float = 0.0
    stiffness_count: float = 0.0
    hum: float = 0.0
    hum_rate: float = 0.0


#: Fields that stand in the joint's record of the compiled plant; the others in the cylinder's.
JOINT_FIELDS = ("flex_inertia", "flex_rate", "flex_damping")
CYLINDER_FIELDS = tuple(f.name for f in fields(AxisExtras) if f.name not in JOINT_FIELDS)


@dataclass(frozen=True, slots=True)
class MachineExtras:
    """Extras of the machine as a whole.

    Attributes
    ----------
    contact_stiffness, contact_height, contact_damping : float
        Ground under the tip: ``k d^1.5 max(1 - c v, 0)`` upwards (N/m^1.5, s/m) with the depth d
        below the height (m, along z of the base frame) and the tip's vertical speed v.
    supply_ripple, supply_ripple_rate : float
        Periodic part of the supply's pressure, Pa, rad/s.
    disturbance_n, disturbance_time_s : float
        Standard deviation and correlation time of a random force at every piston.
    gust_n, gust_time_s : float
        The same of a second, slower one.
    shake, shake_time_s : float
        Standard deviation and correlation time of a random motion of every spool, normalised.
    process_seed : int
        Of all three.
    command_delay_s : float
        Between command and spool, beyond the whole cycles of `Truth`.
    """

    contact_stiffness: float = 0.0
    contact_height: float = 0.0
    contact_damping: float = 0.5
    supply_ripple: float = 0.0
    supply_ripple_rate: float = 0.0
    disturbance_n: float = 0.0
    disturbance_time_s: float = 0.02
    gust_n: float = 0.0
    gust_time_s: float = 3.0
    shake: float = 0.0
    shake_time_s: float = 0.05
    process_seed: int = 0
    command_delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SensorExtras:
    """Extras of the instruments.

    Attributes
    ----------
    pressure_gain : mapping of str to float
        Relative error of a transducer's span, by pressure name.
    pressure_delay_s : mapping of str to float
        Age of a reading, by pressure name; between samples interpolated.
    encoder_swing, encoder_swing_count : mapping of str to float
        Reading error ``a sin(count q)`` of an encoder off its centre, by joint: rad, 1/rad.
    hum_pa, hum_hz : mapping of str to float
        Reading error ``a sin(2 pi f t)``, by pressure name.
    wander_pa, wander_time_s : float
        Standard deviation and correlation time of a slow error of every transducer.
    """

    pressure_gain: Mapping[str, float] = field(default_factory=dict)
    pressure_delay_s: Mapping[str, float] = field(default_factory=dict)
    encoder_swing: Mapping[str, float] = field(default_factory=dict)
    encoder_swing_count: Mapping[str, float] = field(default_factory=dict)
    hum_pa: Mapping[str, float] = field(default_factory=dict)
    hum_hz: Mapping[str, float] = field(default_factory=dict)
    wander_pa: float = 0.0
    wander_time_s: float = 0.1

    @property
    def any(self) -> bool:
        """Whether there is anything but zeros."""
        maps = (getattr(self, f.name) for f in fields(self))
        named = any(any(m.values()) for m in maps if isinstance(m, Mapping))
        return named or self.wander_pa != 0.0


@dataclass(frozen=True, slots=True)
class Extras:
    """All extras of a machine; none by default.

    Attributes
    ----------
    axes : tuple of AxisExtras
        One per cylinder in the robot's order, or empty.
    machine : MachineExtras
    sensors : SensorExtras
    """

    axes: tuple[AxisExtras, ...] = ()
    machine: MachineExtras = field(default_factory=MachineExtras)
    sensors: SensorExtras = field(default_factory=SensorExtras)

    @property
    def in_plant(self) -> bool:
        """Whether the plant itself (not only its instruments) has any."""
        return any(axis != AxisExtras() for axis in self.axes) or self.machine != MachineExtras()
