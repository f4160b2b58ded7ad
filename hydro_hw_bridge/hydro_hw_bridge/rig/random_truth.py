"""Random machines: physical, and far enough from the datasheet to be worth identifying."""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.extras import Extras, MachineExtras, SensorExtras
from hydro_hw_bridge.rig.truth import (
    CylinderTruth,
    FluidTruth,
    LinkTruth,
    SensorTruth,
    SupplyTruth,
    Truth,
    ValveTruth,
    check_physical,
    links_of,
)
from hydro_model.robot import Cylinder, CylinderPart, FloatArray, Robot, Valve

#: Factors by which inertia misses the datasheet, either way.
INERTIA_ERROR = (0.10, 0.30)
EDGE_ERROR = 0.20


def random_truth(robot: Robot, seed: int) -> Truth:
    """A machine of the robot's geometry with everything else its own.

    Mass, centre of mass and the principal second moments of each link miss the datasheet by 10
    to 30 %: independent draws of base parameters would mostly be no body at all.

    Parameters
    ----------
    robot : Robot
        With full link inertia.
    seed : int

    Returns
    -------
    Truth

    Raises
    ------
    BridgeError
        The robot's own inertia is no physical body.
    """
    random = np.random.default_rng(seed)
    return Truth(
        name=f"random:{seed}",
        links=tuple(_link(link, random) for link in links_of(robot)),
        cylinders=tuple(_cylinder(c, random) for c in robot.cylinders),
        valves=tuple(_valve(v, random) for v in robot.valves),
        fluid=FluidTruth(
            bulk_modulus_pa=random.uniform(0.75e9, 0.95e9),
            low_pressure_loss=random.uniform(0.1, 0.4),
            low_pressure_scale_pa=random.uniform(1.0e6, 3.0e6),
        ),
        supply=SupplyTruth(
            pressure_pa=robot.supply_pressure_pa * random.uniform(0.97, 1.02),
            tank_pressure_pa=robot.tank_pressure_pa * random.uniform(0.7, 1.2),
            droop=random.uniform(1.0e8, 4.0e8),
            droop_quadratic=random.uniform(0.5e11, 2.0e11),
            droop_lag_s=random.uniform(0.04, 0.12),
            tank_resistance=random.uniform(0.5e11, 2.0e11),
            tank_lag_s=random.uniform(0.01, 0.04),
        ),
        sensors=SensorTruth(
            pressure_noise_pa=random.uniform(2.0e3, 6.0e3),
            encoder_noise_counts=0.5,
            spool_noise=2.0e-4,
            oil_temperature_c=random.uniform(35.0, 55.0),
        ),
        command_delay_cycles=1,
    )


def plain_truth(robot: Robot, seed: int) -> Truth:
    """A machine that a plain model explains: rigid bodies, viscous friction, edges and oil.

    Its numbers miss the datasheet like `random_truth`'s; sensors are noisy and wander, and small
    random forces and motions shake every piston and spool. Nothing else: no dry friction, no dead
    band, no leakage.

    Parameters
    ----------
    robot : Robot
        With full link inertia.
    seed : int

    Returns
    -------
    Truth
        Without droop; the command is late by up to one cycle.

    Raises
    ------
    BridgeError
        The robot's own inertia is no physical body.
    """
    random = np.random.default_rng(seed)
    links = tuple(_link(link, random) for link in links_of(robot))
    cylinders = tuple(
        CylinderTruth(
            c.name,
            viscous_friction=random.uniform(20.0e3, 45.0e3) * c.area_a_m2 / 5.0e-3,
            barrel=_part(c.barrel, random),
            rod=_part(c.rod, random),
        )
        for c in robot.cylinders
    )
    valves = []
    for valve in robot.valves:
        pa, at, pb, bt = 1.0 + random.uniform(-EDGE_ERROR, EDGE_ERROR, 4)
        edges = valve.c_pa * pa, valve.c_at * at, valve.c_pb * pb, valve.c_bt * bt
        valves.append(ValveTruth(valve.name, *edges, transition_pressure_pa=5.0e3))
    machine = MachineExtras(
        disturbance_n=log_uniform(random, 5.0, 60.0),
        disturbance_time_s=log_uniform(random, 0.02, 0.3),
        shake=log_uniform(random, 5.0e-5, 5.0e-4),
        shake_time_s=log_uniform(random, 0.02, 0.3),
        process_seed=int(random.integers(1 << 31)),
        command_delay_s=random.uniform(0.0, 1.0) / robot.sensors.rate_hz,
    )
    return Truth(
        name="plain",
        links=links,
        cylinders=cylinders,
        valves=tuple(valves),
        fluid=FluidTruth(random.uniform(0.7e9, 1.3e9)),
        supply=SupplyTruth(robot.supply_pressure_pa, robot.tank_pressure_pa),
        sensors=SensorTruth(
            pressure_noise_pa=log_uniform(random, 1.0e3, 8.0e3),
            encoder_noise_counts=random.uniform(0.2, 0.8),
            oil_temperature_c=random.uniform(25.0, 55.0),
        ),
        extras=Extras(
            machine=machine,
            sensors=SensorExtras(
                wander_pa=log_uniform(random, 0.5e3, 5.0e3),
                wander_time_s=log_uniform(random, 0.02, 0.3),
            ),
        ),
    )


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """A number between two, as likely in every decade.

    Parameters
    ----------
    random : numpy.random.Generator
        One number is drawn.
    low, high : float
        Above 0.

    Returns
    -------
    float
    """
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _miss(random: np.random.Generator, size: int | None = None) -> FloatArray:
    """Factors off 1 by 10 to 30 %, up or down."""
    return np.asarray(
        1.0 + random.choice([-1.0, 1.0], size) * random.uniform(*INERTIA_ERROR, size)
    )


def _link(link: LinkTruth, random: np.random.Generator) -> LinkTruth:
    mass = link.mass_kg * float(_miss(random))
    com = link.com_m * _miss(random, 3)
    # Congruence of the second moment in its principal axes keeps it positive definite.
    values, axes = np.linalg.eigh(link.second_moment())
    moment = axes @ np.diag(values * _miss(random, 3)) @ axes.T
    inertia = np.trace(moment) * np.eye(3) - moment
    changed = LinkTruth(link.name, mass, com, inertia)
    check_physical(changed, "random truth")
    return changed


def _part(part: CylinderPart | None, random: np.random.Generator) -> CylinderPart | None:
    if part is None:
        return None
    mass, com, inertia = _miss(random, 3)
    return CylinderPart(
        part.mass_kg * mass, part.com_from_pin_m * com, part.inertia_com_kg_m2 * inertia
    )


def _cylinder(cylinder: Cylinder, random: np.random.Generator) -> CylinderTruth:
    coulomb = random.uniform(3.0e3, 4.5e3)
    return CylinderTruth(
        name=cylinder.name,
        viscous_friction=random.uniform(25.0e3, 45.0e3),
        coulomb_friction_n=coulomb,
        static_friction_n=coulomb * random.uniform(1.02, 1.15),
        stribeck_velocity_m_s=random.uniform(0.006, 0.02),
        bristle_deflection_m=random.uniform(4.0e-5, 1.0e-4),
        bristle_damping=random.uniform(1.0e5, 3.0e5),
        dead_volume_a_m3=random.uniform(0.7e-3, 1.3e-3),
        dead_volume_b_m3=random.uniform(0.7e-3, 1.3e-3),
        internal_leakage=random.uniform(1.0e-13, 5.0e-13),
        barrel=_part(cylinder.barrel, random),
        rod=_part(cylinder.rod, random),
    )


def _valve(valve: Valve, random: np.random.Generator) -> ValveTruth:
    pa, at, pb, bt = 1.0 + random.uniform(-EDGE_ERROR, EDGE_ERROR, 4)
    return ValveTruth(
        valve.name,
        c_pa=valve.c_pa * pa,
        c_at=valve.c_at * at,
        c_pb=valve.c_pb * pb,
        c_bt=valve.c_bt * bt,
        deadband=random.uniform(0.007, 0.013),
        deadband_rounding=random.uniform(0.5e-3, 1.5e-3),
        null_bias=float(random.choice([-1.0, 1.0]) * random.uniform(0.003, 0.007)),
        natural_frequency_hz=random.uniform(80.0, 120.0),
        damping_ratio=random.uniform(0.6, 0.9),
        rate_limit_1_s=random.uniform(60.0, 100.0),
        transition_pressure_pa=random.uniform(3.0e4, 8.0e4),
    )
