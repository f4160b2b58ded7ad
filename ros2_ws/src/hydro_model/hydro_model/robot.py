"""The robot description: plain frozen records, SI units, no behaviour beyond look-ups.

Everything else (dynamics, hydraulics, control, the rig) starts from a `Robot`. How it is read
from files is in `hydro_model.robot_files`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hydro_model.arrays import FloatArray as FloatArray
from hydro_model.errors import RobotError

#: Standard inertial parameters of a link, in this order everywhere (eq. 28 of the paper):
#: first moments and inertia in the joint frame, inertia about the joint frame's origin.
STANDARD_PARAMETERS = ("mass", "mcx", "mcy", "mcz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
STANDARD_UNITS = ("kg", "kg m", "kg m", "kg m") + ("kg m^2",) * 6

#: Parameters of a cylinder's barrel or rod, `<cylinder>_barrel.<parameter>`: mass, first moment
#: along the line from its own pin, inertia about that pin transverse to the line.
PART_PARAMETERS = ("mass", "mcx", "izz")
PARTS = ("barrel", "rod")


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint of the chain and where its child frame sits in its parent frame.

    Attributes
    ----------
    name, parent_link, child_link : str
        Names of the URDF.
    prismatic : bool
        Slides along `axis` (m) instead of turning about it (rad).
    translation_m : (3,) array
        Origin of the child frame in the parent frame at q = 0.
    rotation : (3, 3) array
        Child-frame axes (columns) in the parent frame at q = 0.
    axis : (3,) array
        Unit axis, the same in the parent-side and child frames of the joint.
    lower, upper : float
        Position limits, rad or m.
    velocity_limit, effort_limit : float
        rad/s or m/s; N m or N.
    viscous_friction : float
        N m s/rad or N s/m, of a joint without cylinder only (`<dynamics damping>` of the URDF):
        where there is a cylinder, the friction is the piston's.
    armature : float
        Inertia that the joint's own acceleration alone meets, kg m^2 or kg: `M_ii` without its
        coupling to other joints. No file states it; an effect's change of the robot may.
    """

    name: str
    parent_link: str
    child_link: str
    prismatic: bool
    translation_m: FloatArray
    rotation: FloatArray
    axis: FloatArray
    lower: float
    upper: float
    velocity_limit: float
    effort_limit: float
    viscous_friction: float = 0.0
    armature: float = 0.0


@dataclass(frozen=True, slots=True)
class CylinderPart:
    """Barrel or rod: a slender body on the line between the two pins.

    Attributes
    ----------
    mass_kg : float
    com_from_pin_m : float
        Centre of mass along the cylinder's line from the part's own pin
        (barrel: parent pin; rod: child pin).
    inertia_com_kg_m2 : float
        About the centre of mass, transverse to the line.
    """

    mass_kg: float
    com_from_pin_m: float
    inertia_com_kg_m2: float

    @property
    def parameters(self) -> tuple[float, float, float]:
        """`PART_PARAMETERS`: mass, first moment and inertia about the pin."""
        moment = self.mass_kg * self.com_from_pin_m
        return self.mass_kg, moment, self.inertia_com_kg_m2 + moment * self.com_from_pin_m


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A differential cylinder and the triangle that ties it to its joint (eq. 16 corrected).

    ``x(q) = sqrt(l1^2 + l2^2 - 2 l1 l2 cos(q + q0)) - x0``. With `l1_m` = 0 the cylinder sits
    directly on a prismatic joint and ``x(q) = q - x0``.

    Attributes
    ----------
    name, joint : str
    bore_m, rod_m, stroke_m : float
        Diameters and stroke. Chamber A is the bore side.
    l1_m, l2_m : float
        From the joint axis to the pin on the parent and on the child link.
    q0_rad, x0_m : float
        Angle offset; pin-to-pin length at x = 0.
    child_pin_angle_rad : float
        Direction of the child-link pin in the child frame, from the x axis, positive in the
        joint's own sense of rotation.
    barrel, rod : CylinderPart or None
        On a triangle; those of one directly on a joint are parts of its links.
    bulk_modulus_pa : float
        Effective bulk modulus of both chambers.
    viscous_friction : float
        N s/m at the piston.
    stroke_sensor : bool
        `/joint_states` carries the stroke as an entry named after the cylinder.
    """

    name: str
    joint: str
    bore_m: float
    rod_m: float
    stroke_m: float
    l1_m: float
    l2_m: float
    q0_rad: float
    x0_m: float
    child_pin_angle_rad: float
    barrel: CylinderPart | None
    rod: CylinderPart | None
    bulk_modulus_pa: float
    viscous_friction: float = 0.0
    stroke_sensor: bool = False

    @property
    def area_a_m2(self) -> float:
        """Bore area A1 in m^2."""
        return float(np.pi * self.bore_m**2 / 4.0)

    @property
    def area_b_m2(self) -> float:
        """Annulus A2 in m^2: bore area less rod area (erratum of eq. 9)."""
        return float(np.pi * (self.bore_m**2 - self.rod_m**2) / 4.0)


@dataclass(frozen=True, slots=True)
class Valve:
    """A 4/3 valve: edge coefficients at full signal, m^3/(s sqrt(Pa)) (eqs. 11 and 12).

    Attributes
    ----------
    name, cylinder : str
    rated_voltage_v : float
        Voltage of full opening; the normalised signal is u = V / rated.
    c_pa, c_at, c_pb, c_bt : float
    command_delay_s : float
        How much later than the others it follows its commands.
    """

    name: str
    cylinder: str
    rated_voltage_v: float
    c_pa: float
    c_at: float
    c_pb: float
    c_bt: float
    command_delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Sensors:
    """Rates and resolutions of the instrumentation.

    Attributes
    ----------
    rate_hz : float
    encoder_counts_per_rev : int
    pressure_range_pa, pressure_resolution_pa : float
    """

    rate_hz: float = 500.0
    encoder_counts_per_rev: int = 1 << 20
    pressure_range_pa: float = 25.0e6
    pressure_resolution_pa: float = 1000.0


@dataclass(frozen=True, slots=True)
class BaseParameter:
    """An identifiable combination of standard inertial parameters and its value.

    Attributes
    ----------
    name : str
        Its leading standard parameter, `<link>.<parameter>`.
    combination : mapping
        Coefficients over standard parameters, the leading one's being 1.
    value : float
        In the leading parameter's unit.
    """

    name: str
    combination: Mapping[str, float]
    value: float


@dataclass(frozen=True, slots=True)
class EffectSpec:
    """An effect that the robot file lists: catalogue name, target and parameters.

    Attributes
    ----------
    name : str
        Name of the catalogue (`hydro_model.effects`).
    target : str
        Cylinder, valve or joint it acts on, or the robot's name where it acts on all.
    parameters : mapping of str to float
        SI values by parameter name.
    """

    name: str
    target: str
    parameters: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Robot:
    """A serial chain with its cylinders, valves and sensors.

    Attributes
    ----------
    name : str
    joints : tuple of Joint
        From the base outwards; joint i moves link i.
    link_inertia : (n, 10) array
        Standard parameters per moving link, fixed attachments lumped in. Where the model file
        gives base parameters, the leading parameters carry them and the others are zero, which
        yields the same dynamics.
    tip_link : str
    tip_offset_m : (3,) array
        Tip in the last joint frame.
    gravity_m_s2 : (3,) array
        In the base frame.
    cylinders : tuple of Cylinder
    valves : tuple of Valve
    sensors : Sensors
    atmospheric_pressure_pa, supply_pressure_pa, tank_pressure_pa : float
        Atmosphere absolute; supply and tank gauge.
    command_delay_s : float
    effects : tuple of EffectSpec
    base_parameters : tuple of BaseParameter
        Empty for a datasheet robot.
    base_covariance : (p, p) array or None
    part_inertia : (2 k, 3) array or None
        `PART_PARAMETERS` of barrel and rod of every closed chain, in the place of the
        cylinders' own: an identified robot has regrouped them with the links'.
    standard_deviations : mapping of str to float
        Of the other identified numbers, by the names of the identification's result file.
    standard_parameters : mapping of str to float
        Physically consistent `<link>.<parameter>` that reproduce the base parameters; empty where
        there are none. For other tools and as a reference: the dynamics are `link_inertia`'s.
    source : Path or None
        The file it was read from.
    urdf : Path or None
    """

    name: str
    joints: tuple[Joint, ...]
    link_inertia: FloatArray
    tip_link: str
    tip_offset_m: FloatArray
    gravity_m_s2: FloatArray
    cylinders: tuple[Cylinder, ...]
    valves: tuple[Valve, ...]
    sensors: Sensors = field(default_factory=Sensors)
    atmospheric_pressure_pa: float = 101325.0
    supply_pressure_pa: float = 0.0
    tank_pressure_pa: float = 0.0
    command_delay_s: float = 0.0
    effects: tuple[EffectSpec, ...] = ()
    base_parameters: tuple[BaseParameter, ...] = ()
    base_covariance: FloatArray | None = None
    part_inertia: FloatArray | None = None
    standard_deviations: Mapping[str, float] = field(default_factory=dict)
    standard_parameters: Mapping[str, float] = field(default_factory=dict)
    source: Path | None = None
    urdf: Path | None = None

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return len(self.joints)

    @property
    def encoder_steps(self) -> FloatArray:
        """Angle of one count of each joint's encoder, (n,), rad.

        0 for a joint that slides: counts per revolution are no resolution in metres.
        """
        step = 2.0 * np.pi / self.sensors.encoder_counts_per_rev
        return np.array([0.0 if joint.prismatic else step for joint in self.joints])

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints from the base outwards."""
        return tuple(joint.name for joint in self.joints)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the moving links, link i moved by joint i."""
        return tuple(joint.child_link for joint in self.joints)

    @property
    def standard_names(self) -> tuple[str, ...]:
        """The 10 n names `<link>.<parameter>` in regressor column order."""
        return tuple(f"{link}.{p}" for link in self.link_names for p in STANDARD_PARAMETERS)

    @property
    def closed_chains(self) -> tuple[Cylinder, ...]:
        """The k cylinders on triangles, whose barrels and rods turn against the links."""
        return tuple(c for c in self.cylinders if c.l1_m != 0.0)

    @property
    def part_names(self) -> tuple[str, ...]:
        """The 6 k names `<cylinder>_<barrel or rod>.<parameter>` in regressor column order."""
        return tuple(
            f"{c.name}_{part}.{p}"
            for c in self.closed_chains
            for part in PARTS
            for p in PART_PARAMETERS
        )

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """All columns of the regressor: `standard_names`, then `part_names`."""
        return (*self.standard_names, *self.part_names)

    @property
    def part_parameters(self) -> FloatArray:
        """`part_inertia`, or where that is None what the cylinders' records say, (2 k, 3)."""
        if self.part_inertia is not None:
            return self.part_inertia
        parts = [part for c in self.closed_chains for part in (c.barrel, c.rod)]
        rows = [(0.0, 0.0, 0.0) if part is None else part.parameters for part in parts]
        return np.array(rows, dtype=np.float64).reshape(-1, len(PART_PARAMETERS))

    @property
    def parameter_vector(self) -> FloatArray:
        """Values of `parameter_names`: the regressor times these is the inverse dynamics."""
        return np.concatenate([self.link_inertia.ravel(), self.part_parameters.ravel()])

    @property
    def pressure_names(self) -> tuple[str, ...]:
        """Entries of `/chamber_pressures`: every chamber, then supply and tank."""
        chambers = [f"{c.name}/{side}" for c in self.cylinders for side in "ab"]
        return (*chambers, "supply", "tank")

    @property
    def valve_names(self) -> tuple[str, ...]:
        """Names of the valves."""
        return tuple(valve.name for valve in self.valves)

    @property
    def dry_joints(self) -> tuple[int, ...]:
        """Indices of the joints that no cylinder moves."""
        driven = {cylinder.joint for cylinder in self.cylinders}
        return tuple(i for i, joint in enumerate(self.joints) if joint.name not in driven)

    def joint_index(self, name: str) -> int:
        """Index of a joint by name; raises RobotError naming the known joints."""
        return _find(self.joint_names, name, "joint", self.name)

    def cylinder(self, name: str) -> Cylinder:
        """Cylinder by name; raises RobotError naming the known cylinders."""
        names = tuple(c.name for c in self.cylinders)
        return self.cylinders[_find(names, name, "cylinder", self.name)]

    def valve_of(self, cylinder: str) -> Valve:
        """The valve that feeds a cylinder; raises RobotError where there is none."""
        names = tuple(valve.cylinder for valve in self.valves)
        return self.valves[_find(names, cylinder, "valve for cylinder", self.name)]

    def cylinder_of(self, joint: str) -> Cylinder:
        """The cylinder that moves a joint; raises RobotError where there is none."""
        names = tuple(c.joint for c in self.cylinders)
        return self.cylinders[_find(names, joint, "cylinder on joint", self.name)]


def _find(names: tuple[str, ...], name: str, what: str, robot: str) -> int:
    if name not in names:
        known = ", ".join(names) or "none"
        raise RobotError(f"robot {robot} has no {what} '{name}' (known: {known})")
    return names.index(name)
