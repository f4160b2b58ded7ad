"""What the simulated machine really is: plain frozen records of the truth plant's numbers.

Lengths, areas and pin positions are the robot's own; everything else of the plant is here.
Files are read by `hydro_hw_bridge.rig.truth_files`, random machines made by
`hydro_hw_bridge.rig.random_truth`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.extras import Extras
from hydro_model.robot import CylinderPart, FloatArray, Robot


@dataclass(frozen=True, slots=True)
class LinkTruth:
    """Inertia of one moving link.

    Attributes
    ----------
    name : str
    mass_kg : float
    com_m : (3,) array
        In the link's (joint) frame.
    inertia_com_kg_m2 : (3, 3) array
        About the centre of mass, in the link's axes.
    """

    name: str
    mass_kg: float
    com_m: FloatArray
    inertia_com_kg_m2: FloatArray

    def second_moment(self) -> FloatArray:
        """Central second moment of mass ``tr(I)/2 1 - I``, (3, 3); positive for a real body."""
        inertia = self.inertia_com_kg_m2
        return np.asarray(0.5 * np.trace(inertia) * np.eye(3) - inertia)


@dataclass(frozen=True, slots=True)
class CylinderTruth:
    """Friction, volumes and bodies of one cylinder.

    The friction force follows a bristle of deflection z (Canudas de Wit et al., IEEE Trans.
    Automatic Control 40(3), 1995): ``z' = v - stiffness |v| z / g(v)``,
    ``g = Fc + (Fs - Fc) exp(-(v / vs)^2)``, ``F = stiffness z + damping z' + viscous v``, with
    ``stiffness = Fc / bristle_deflection_m``.

    Attributes
    ----------
    name : str
    viscous_friction : float
        N s/m.
    coulomb_friction_n, static_friction_n : float
        Fc and Fs; 0 leaves the bristle out.
    stribeck_velocity_m_s, bristle_deflection_m : float
    bristle_damping : float
        N s/m.
    dead_volume_a_m3, dead_volume_b_m3 : float
        Oil of chamber and line that the piston never sweeps.
    internal_leakage, external_leakage_a, external_leakage_b : float
        m^3/(s Pa), laminar: between the chambers; from each chamber to the surroundings.
    barrel, rod : CylinderPart or None
    """

    name: str
    viscous_friction: float = 0.0
    coulomb_friction_n: float = 0.0
    static_friction_n: float = 0.0
    stribeck_velocity_m_s: float = 0.01
    bristle_deflection_m: float = 5.0e-5
    bristle_damping: float = 0.0
    dead_volume_a_m3: float = 0.0
    dead_volume_b_m3: float = 0.0
    internal_leakage: float = 0.0
    external_leakage_a: float = 0.0
    external_leakage_b: float = 0.0
    barrel: CylinderPart | None = None
    rod: CylinderPart | None = None


@dataclass(frozen=True, slots=True)
class ValveTruth:
    """Edges and spool of one valve.

    Attributes
    ----------
    name : str
    c_pa, c_at, c_pb, c_bt : float
        m^3/(s sqrt(Pa)) at full opening.
    deadband, deadband_rounding : float
        Half width of the dead zone and radius of its corners, both in normalised signal.
    null_bias : float
        Opening at zero spool position, normalised.
    natural_frequency_hz, damping_ratio, rate_limit_1_s : float
        Second-order spool and its speed limit in full strokes per second; a natural frequency
        of 0 is a spool without dynamics.
    transition_pressure_pa : float
        Pressure drop around which the flow turns from laminar to turbulent.
    """

    name: str
    c_pa: float
    c_at: float
    c_pb: float
    c_bt: float
    deadband: float = 0.0
    deadband_rounding: float = 1.0e-3
    null_bias: float = 0.0
    natural_frequency_hz: float = 0.0
    damping_ratio: float = 0.7
    rate_limit_1_s: float = 80.0
    transition_pressure_pa: float = 4.0e4


@dataclass(frozen=True, slots=True)
class FluidTruth:
    """Stiffness of the oil: ``beta(p) = bulk_modulus (1 - low_pressure_loss exp(-p / scale))``.

    The form of Hoffmann's curve (as in Jelali and Kroll, Hydraulic Servo-systems, 2003, sec.
    2.3), p absolute.

    Attributes
    ----------
    bulk_modulus_pa : float
        Far above the scale pressure.
    low_pressure_loss : float
        Fraction lost at zero absolute pressure, below 1.
    low_pressure_scale_pa : float
    """

    bulk_modulus_pa: float
    low_pressure_loss: float = 0.0
    low_pressure_scale_pa: float = 2.0e6


@dataclass(frozen=True, slots=True)
class SupplyTruth:
    """Pump and tank lines: gauge pressures that lag behind what the flow asks of them.

    Attributes
    ----------
    pressure_pa, tank_pressure_pa : float
        At zero flow.
    droop : float
        Pa s/m^3, proportional part of the supply's droop.
    droop_quadratic : float
        Pa s^2/m^6.
    droop_lag_s : float
    tank_resistance : float
        Pa s^2/m^6, quadratic back pressure of the return line.
    tank_lag_s : float
    """

    pressure_pa: float
    tank_pressure_pa: float
    droop: float = 0.0
    droop_quadratic: float = 0.0
    droop_lag_s: float = 0.05
    tank_resistance: float = 0.0
    tank_lag_s: float = 0.02


@dataclass(frozen=True, slots=True)
class SensorTruth:
    """Imperfections of the instruments. Resolutions are the robot's.

    Attributes
    ----------
    quantised : bool
        False reports real numbers: for anchors only, a bus cannot carry them.
    pressure_noise_pa : float
        Standard deviation before quantisation.
    encoder_noise_counts : float
    spool_noise : float
        Normalised.
    pressure_bias_pa : mapping of str to float
        By pressure name (`<cylinder>/a`, ..., `supply`, `tank`); 0 where absent.
    encoder_offset : mapping of str to float
        By joint, rad or m; 0 where absent.
    oil_temperature_c : float
    """

    quantised: bool = True
    pressure_noise_pa: float = 0.0
    encoder_noise_counts: float = 0.0
    spool_noise: float = 0.0
    pressure_bias_pa: Mapping[str, float] = field(default_factory=dict)
    encoder_offset: Mapping[str, float] = field(default_factory=dict)
    oil_temperature_c: float = 45.0


@dataclass(frozen=True, slots=True)
class Truth:
    """A whole machine.

    Attributes
    ----------
    name : str
    links : tuple of LinkTruth
    cylinders : tuple of CylinderTruth
    valves : tuple of ValveTruth
        All three in the robot's order.
    fluid : FluidTruth
    supply : SupplyTruth
    sensors : SensorTruth
    command_delay_cycles : int
        Whole cycles between a valve frame and the amplifier's output.
    gravity_m_s2 : (3,) array or None
        In the frame that the robot's file calls its base: a machine that does not stand level;
        None: as the file has it.
    extras : Extras
        None by default.
    """

    name: str
    links: tuple[LinkTruth, ...]
    cylinders: tuple[CylinderTruth, ...]
    valves: tuple[ValveTruth, ...]
    fluid: FluidTruth
    supply: SupplyTruth
    sensors: SensorTruth = field(default_factory=SensorTruth)
    command_delay_cycles: int = 0
    gravity_m_s2: FloatArray | None = None
    extras: Extras = field(default_factory=Extras)

    @staticmethod
    def ideal(robot: Robot, *, quantised: bool = False) -> Truth:
        """The plant that equals the datasheet, with perfect signals: for anchors, never a proof.

        Parameters
        ----------
        robot : Robot
            With full link inertia; one bulk modulus for all cylinders.
        quantised : bool
            Readings in the counts a bus carries.

        Raises
        ------
        BridgeError
            The robot's inertia is no physical body (a model of base parameters is none), or its
            cylinders differ in bulk modulus.
        """
        moduli = {c.bulk_modulus_pa for c in robot.cylinders} or {1.0e9}
        if len(moduli) > 1:
            raise BridgeError(
                f"robot {robot.name}: the rig has one oil, found bulk moduli {sorted(moduli)} Pa;"
                " where these were identified, give the rig the file that was identified from"
            )
        return Truth(
            name="ideal",
            links=links_of(robot),
            cylinders=tuple(
                CylinderTruth(c.name, c.viscous_friction, barrel=c.barrel, rod=c.rod)
                for c in robot.cylinders
            ),
            valves=tuple(ValveTruth(v.name, v.c_pa, v.c_at, v.c_pb, v.c_bt) for v in robot.valves),
            fluid=FluidTruth(moduli.pop()),
            supply=SupplyTruth(robot.supply_pressure_pa, robot.tank_pressure_pa),
            sensors=SensorTruth(quantised=quantised),
        )


def links_of(robot: Robot) -> tuple[LinkTruth, ...]:
    """The robot's links with their inertia about the centre of mass.

    Raises
    ------
    BridgeError
        A link is no physical body.
    """
    links = []
    for name, row in zip(robot.link_names, robot.link_inertia, strict=True):
        mass, moment = float(row[0]), np.array(row[1:4])
        xx, xy, xz, yy, yz, zz = row[4:10]
        about_joint = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if mass <= 0.0 and np.any(moment):
            raise BridgeError(
                f"{robot.name}: link '{name}' is no physical body: first moments without a mass"
                " (a model of base parameters is no machine)"
            )
        com = moment / mass if mass > 0.0 else np.zeros(3)
        # Steiner: about the joint = about the centre of mass + m (c.c 1 - c c^T).
        central = about_joint - mass * (com @ com * np.eye(3) - np.outer(com, com))
        link = LinkTruth(name, mass, com, central)
        check_physical(link, robot.name)
        links.append(link)
    return tuple(links)


def check_physical(link: LinkTruth, where: str) -> None:
    """Raise BridgeError unless the link's pseudo-inertia is positive definite.

    With the centre of mass as origin that is a positive mass and a positive definite second
    moment (Wensing, Kim and Slotine, IEEE RA-L 3(1), 2018). A link without mass and inertia,
    a mere frame, passes too. `where` begins the error: the file and the link.
    """
    moment = link.second_moment()
    if link.mass_kg == 0.0 and not np.any(moment):
        return
    lowest = float(np.linalg.eigvalsh(moment)[0])
    if link.mass_kg <= 0.0 or lowest <= 0.0:
        raise BridgeError(
            f"{where}: link '{link.name}' is no physical body: expected a positive mass and"
            f" a positive definite second moment, found {link.mass_kg:g} kg and a lowest"
            f" second moment of {lowest:g} kg m^2"
        )
