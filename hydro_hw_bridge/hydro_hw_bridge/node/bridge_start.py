"""What the bridge's node starts from: its parameters, and the parts that follow from them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.claims import Claim
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.node.parameters import LOCKSTEP, PARAMETERS, Settings, settings_from
from hydro_hw_bridge.protocol.calibration import Calibration, load_calibration, unmeasured
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.mapping import BusMapping
from hydro_model.robot import Robot
from hydro_msgs_docs.node_parameters import declare, values_of
from hydro_msgs_docs.real_time import RealTime


@dataclass(frozen=True, slots=True)
class BridgeParts:
    """What a bridge is made of before it runs.

    Attributes
    ----------
    settings : Settings
    codec : Codec
    limits : GateLimits
    bus : Bus
    claim : Claim
        Taken.
    real_time : RealTime
    """

    settings: Settings
    codec: Codec
    limits: GateLimits
    bus: Bus
    claim: Claim
    real_time: RealTime


def declared(node: Node) -> Settings:
    """Declare the bridge's parameters and read what they are set to.

    Parameters
    ----------
    node : rclpy.node.Node

    Raises
    ------
    ParameterError, BridgeError, RealTimeError
        A value is of another type or out of range, or as of `settings_from`.
    """
    declare(node, PARAMETERS, read_only=True)
    return settings_from(values_of(node, PARAMETERS))


def loaded_calibration(settings: Settings) -> Calibration | None:
    """The calibration that the parameters ask for; None where they ask for none.

    Parameters
    ----------
    settings : Settings

    Raises
    ------
    BridgeError
        The file is missing or malformed.
    """
    return load_calibration(Path(settings.calibration)) if settings.calibration else None


def loaded_codec(
    settings: Settings, robot: Robot, calibration: Calibration | None
) -> tuple[Codec, dict[str, str]]:
    """The codec that the parameters ask for, and the names to report it by.

    Parameters
    ----------
    settings : Settings
    robot : Robot
    calibration : Calibration or None

    Returns
    -------
    codec : Codec
    names : dict of str to str
        Of robot, bus, mapping and calibration.

    Raises
    ------
    BridgeError
        A file is missing or malformed, the calibration is of another machine, or the supply's
        pressure is to be watched and not mapped.
    ContractError
        No mapping is named, and none is shipped for the robot.
    """
    codec = Codec.load(settings.dbc or None, settings.mapping or None, robot, calibration)
    if settings.min_supply_pa > 0.0 and "supply" not in codec.pressure_names:
        raise BridgeError(
            f"{codec.mapping.source}: parameter 'min_supply_pa' needs a pressure 'supply',"
            f" found {', '.join(codec.pressure_names)} (0 switches the check off)"
        )
    names = {
        "robot": robot.name,
        "can": settings.can,
        "mapping": codec.mapping.name,
        "calibration": calibration.name if calibration else "none",
    }
    return codec, names


def calibration_remarks(mapping: BusMapping, calibration: Calibration | None) -> list[str]:
    """What to say of a calibration that is used.

    Parameters
    ----------
    mapping : BusMapping
    calibration : Calibration or None

    Returns
    -------
    list of str
        A line each; that of what it lacks says that it is not driven with.
    """
    if calibration is None:
        return []
    remarks = []
    if not calibration.channels:
        remarks.append(
            f"calibration {calibration.name} does not say with which channels of {mapping.source}"
            " it was measured (no mapping_channels, a file of before): it is taken as one of these"
        )
    if lacking := unmeasured(mapping, calibration):
        remarks.append(f"not driven with {lacking}")
    return remarks


def not_quite_zero(codec: Codec) -> list[str]:
    """What to say of valves to which the bus cannot tell 0 V.

    Parameters
    ----------
    codec : Codec

    Returns
    -------
    list of str
        A line per valve. Half a count is no reason to refuse one: many a null bias is larger.
    """
    return [
        f"{codec.mapping.source}: 0 V of valve '{name}' is no whole count of its signal:"
        f" enabled and commanded 0 V, it gets {1e3 * value:+.3g} mV"
        for name, value in codec.zero_v.items()
    ]


def gate_limits(settings: Settings, robot: Robot) -> GateLimits:
    """The gate's limits for the robot's valves and cycle.

    Parameters
    ----------
    settings : Settings
    robot : Robot

    Raises
    ------
    BridgeError
        A command may be no older than a cycle of the device, or than two in real time, where the
        next one is never there on the dot.
    """
    period_s = 1.0 / robot.sensors.rate_hz
    max_age_cycles = int(1e-3 * settings.max_age_ms / period_s + 1e-6)
    least = 1 if settings.clock == LOCKSTEP else 2
    if max_age_cycles < least:
        raise BridgeError(
            f"parameter 'max_age_ms': expected at least {1e3 * least * period_s:g} ms, {least}"
            f" cycles of the device at {robot.sensors.rate_hz:g} Hz (rate_hz of the robot file),"
            f" found {settings.max_age_ms:g}"
        )
    return GateLimits(
        valve_names=robot.valve_names,
        rated_voltage_v=tuple(valve.rated_voltage_v for valve in robot.valves),
        period_s=period_s,
        slew_v_s=settings.slew_limit_v_s,
        max_age_cycles=max_age_cycles,
        min_supply_pa=settings.min_supply_pa,
        reenable_slew_v_s=settings.reenable_slew_v_s,
    )
