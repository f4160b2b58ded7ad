"""The measurements of a calibration, each on a `Session`."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from itertools import islice

import numpy as np

from hydro_hw_bridge.commissioning.calibration_session import Session
from hydro_hw_bridge.errors import CalibrationError
from hydro_hw_bridge.protocol.frames import Readings
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import Cylinder, FloatArray, Robot, Valve

#: Cycles to average: 0.5 s at 500 Hz.
AVERAGED_CYCLES = 250
#: A transducer that reads more than this with the pump off has pressure on it, or is broken.
MAX_ZERO_PA = 3.0e5
#: Joint movement during averaging above which the machine is not at rest, rad or m.
MAX_MOVEMENT = 2.0e-3
#: Piston movement that settles a valve's sign, and the longest pulse to get it.
SIGN_STROKE_M = 3.0e-3
SIGN_CYCLES = 750
#: Cycles with the valve at 0 V before each pulse: 0.4 s.
REST_CYCLES = 200
#: Of these the last ones tell whether the piston is at rest. What it would creep during the pulse
#: may be so much of the stroke that settles the sign: a null bias makes some.
CREEP_CYCLES = 100
MOST_CREEP = 0.5
_FORCE = "p_a A_a - p_b A_b"
#: A joint against its stop may read so much of its range beyond its limit.
MARGIN = 0.01


def wait_for_inputs(session: Session, *, pump_on: bool, timeout_s: float) -> None:
    """Wait until the pump is off, or until pump, emergency stop and enable allow driving.

    Parameters
    ----------
    session : Session
    pump_on : bool
    timeout_s : float
        Wall time.

    Raises
    ------
    CalibrationError
        They do not in time.
    """
    end = time.monotonic() + timeout_s
    for readings in session.cycles():
        missing = _missing(readings) if pump_on else _pump_runs(readings)
        if not missing:
            return
        if time.monotonic() > end:
            raise CalibrationError(f"{missing}, for {timeout_s:g} s")


def _missing(readings: Readings) -> str:
    status = readings.status
    if not status.emergency_stop_ok:
        return "emergency stop is pressed"
    if not status.enable_switch:
        return "enable switch is off"
    return "" if status.pump_on else "pump is off, expected it on"


def _pump_runs(readings: Readings) -> str:
    return "pump is on, expected it off" if readings.status.pump_on else ""


def _average(session: Session) -> list[Readings]:
    session.drive(None)
    return list(islice(session.cycles(), AVERAGED_CYCLES))


def pressure_zeros(session: Session) -> tuple[dict[str, float], dict[str, float]]:
    """The reading of every pressure transducer with the pump off and no pressure in the oil.

    Parameters
    ----------
    session : Session

    Returns
    -------
    zeros, spread : dict from pressure name to float
        Mean and standard deviation, Pa gauge.

    Raises
    ------
    CalibrationError
        The pump came on, or a transducer is far from zero.
    """
    taken = _average(session)
    if any(readings.status.pump_on for readings in taken):
        raise CalibrationError("pump is on, expected it off while zeros are measured")
    pressures = np.array([readings.pressures_pa for readings in taken])
    means, spreads = pressures.mean(axis=0), pressures.std(axis=0)
    names = session.codec.pressure_names
    for name, mean in zip(names, means, strict=True):
        if abs(mean) > MAX_ZERO_PA:
            raise CalibrationError(
                f"{name} reads {mean / 1e5:.2f} bar gauge with the pump off, expected within"
                f" {MAX_ZERO_PA / 1e5:g} bar of 0: let the pressure out, or change the transducer"
            )
    return _named(names, means), _named(names, spreads)


def _named(names: tuple[str, ...], values: FloatArray) -> dict[str, float]:
    return {name: round(float(value), 1) for name, value in zip(names, values, strict=True)}


def position_offsets(session: Session, references: Mapping[str, float]) -> dict[str, float]:
    """What to add to the encoders so that they read the references.

    Parameters
    ----------
    session : Session
    references : mapping from joint to position
        Where the machine stands, rad or m.

    Returns
    -------
    dict from joint to offset

    Raises
    ------
    CalibrationError
        The machine moves.
    """
    positions = np.array([readings.positions for readings in _average(session)])
    offsets = {}
    for i, name in enumerate(session.codec.joint_names):
        if name not in references:
            continue
        moved = float(np.ptp(positions[:, i]))
        if moved > MAX_MOVEMENT:
            raise CalibrationError(
                f"joint {name} moved by {moved:.4f} while its reference was measured, expected"
                f" at most {MAX_MOVEMENT:g}"
            )
        offsets[name] = float(references[name] - positions[:, i].mean())
    return offsets


def unreferenced(robot: Robot, referenced: Collection[str]) -> list[str]:
    """Joints whose encoders have to be referenced before the signs of their valves mean anything.

    Which way a cylinder moves follows from the joint by the sign of the lever, and with a wrong
    zero the joint reads as on the other side of its dead centre.

    Parameters
    ----------
    robot : Robot
    referenced : collection of str
        Joints with an offset of their own, in this or an earlier calibration.

    Returns
    -------
    list of str
        In the robot's order; without joints that slide along with their cylinders.
    """
    levers = (c.joint for c in robot.cylinders if c.l1_m != 0.0)
    return [name for name in dict.fromkeys(levers) if name not in referenced]


def _check_within(robot: Robot, positions: Mapping[str, float]) -> None:
    """Refuse positions in which no joint can be: their encoders are referenced wrongly."""
    for joint in robot.joints:
        q, margin = positions[joint.name], MARGIN * (joint.upper - joint.lower)
        if not joint.lower - margin <= q <= joint.upper + margin:
            raise CalibrationError(
                f"joint {joint.name} reads {q:.3f} with its offset, expected within its limits"
                f" {joint.lower:g} to {joint.upper:g}: measure its reference anew"
                f" (--reference {joint.name}=VALUE) before --signs"
            )


def valve_signs(
    session: Session,
    robot: Robot,
    offsets: Mapping[str, float],
    share: float,
    say: Callable[[str], None],
) -> dict[str, int]:
    """1 where a positive voltage extends the valve's cylinder, -1 where it retracts it.

    Each voltage is given both ways: a load that creeps goes the same way by either.

    Parameters
    ----------
    session : Session
    robot : Robot
    offsets : mapping from joint to what to add to its position
    share : float
        Of the rated voltage, at most 0.05.
    say : callable
        Told of each valve before it moves, what moved and which force its cylinder held before.

    Returns
    -------
    dict from valve to sign

    Raises
    ------
    CalibrationError
        A joint reads beyond its limits; a valve does not move its cylinder, moves another one, or
        moves it the same way by either voltage; a cylinder moves at 0 V; an input went away.
    """
    joints = session.codec.joint_names
    shift = np.array([offsets.get(name, 0.0) for name in joints])
    at_rest = np.asarray(_rest(session)[-1].positions) + shift
    _check_within(robot, dict(zip(joints, at_rest.tolist(), strict=True)))

    def strokes(readings: Readings) -> FloatArray:
        q = np.asarray(readings.positions) + shift
        return np.array([float(stroke(c, q[robot.joint_index(c.joint)])) for c in robot.cylinders])

    signs = {}
    for valve in robot.valves:
        voltage = share * valve.rated_voltage_v
        say(f"{valve.name}: {voltage:+.2f} V until {valve.cylinder} moves, and back")
        there, back = (
            _moved_by(session, robot, valve, one, strokes, say) for one in (voltage, -voltage)
        )
        if there * back > 0.0:
            raise CalibrationError(
                f"{valve.name} should move {valve.cylinder} one way by {voltage:+.2f} V and the"
                f" other way by {-voltage:+.2f} V, found {1e3 * there:+.1f} mm and"
                f" {1e3 * back:+.1f} mm: the load moves it, hold it, or raise --percent"
            )
        signs[valve.name] = 1 if there > 0.0 else -1
    return signs


def _moved_by(
    session: Session,
    robot: Robot,
    valve: Valve,
    voltage_v: float,
    strokes: Callable[[Readings], FloatArray],
    say: Callable[[str], None],
) -> float:
    """How far a voltage moves the valve's cylinder; refused where something else may have."""
    names = [c.name for c in robot.cylinders]
    own = names.index(valve.cylinder)
    rest = _rest(session)
    start = strokes(rest[-1])
    crept = float((start - strokes(rest[-1 - CREEP_CYCLES]))[own])
    force = _force_n(session, robot.cylinders[own], rest[-1])
    moved, cycles = _pulse(session, valve.name, voltage_v, strokes, own, start)
    found = ", ".join(f"{n} {1e3 * m:+.1f} mm" for n, m in zip(names, moved, strict=True))
    most = int(np.argmax(np.abs(moved)))
    if most != own or abs(moved[own]) < SIGN_STROKE_M:
        raise CalibrationError(
            f"{valve.name} at {voltage_v:.2f} V should move {valve.cylinder} by"
            f" {1e3 * SIGN_STROKE_M:g} mm and more than any other, found {found}"
        )
    if abs(crept) * cycles / CREEP_CYCLES > MOST_CREEP * SIGN_STROKE_M:
        speed = crept / CREEP_CYCLES * robot.sensors.rate_hz
        raise CalibrationError(
            f"{valve.cylinder} should be at rest at 0 V, found {1e3 * speed:+.2f} mm/s beside"
            f" {1e3 * moved[own]:+.1f} mm in {cycles / robot.sensors.rate_hz:.2f} s by"
            f" {voltage_v:+.2f} V of {valve.name}: hold the load, or raise --percent"
        )
    say(f"{valve.name}: {found}; before, {valve.cylinder} held {1e-3 * force:+.1f} kN ({_FORCE})")
    return float(moved[own])


def _force_n(session: Session, cylinder: Cylinder, readings: Readings) -> float:
    """Hydraulic force on a piston, N; above 0 where it pushes the rod out."""
    pressures = dict(zip(session.codec.pressure_names, readings.pressures_pa, strict=True))
    p_a, p_b = pressures[f"{cylinder.name}/a"], pressures[f"{cylinder.name}/b"]
    return p_a * cylinder.area_a_m2 - p_b * cylinder.area_b_m2


def _rest(session: Session) -> list[Readings]:
    """The readings of some cycles at 0 V."""
    session.drive(None)
    return list(islice(session.cycles(), REST_CYCLES))


def _pulse(
    session: Session,
    valve: str,
    voltage_v: float,
    strokes: Callable[[Readings], FloatArray],
    own: int,
    start: FloatArray,
) -> tuple[FloatArray, int]:
    """Drive one valve until its cylinder moved enough, or for long enough; how all moved."""
    moved, cycles = np.zeros_like(start), 0
    session.drive(valve, voltage_v)
    try:
        for readings in islice(session.cycles(), SIGN_CYCLES):
            missing = _missing(readings)
            if missing:
                raise CalibrationError(f"{missing} while {valve} was driven")
            moved, cycles = strokes(readings) - start, cycles + 1
            if abs(moved[own]) >= SIGN_STROKE_M:
                break
    finally:
        session.stop()
    return moved, cycles
