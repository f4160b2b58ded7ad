"""The bridge's state in words and numbers, for `/diagnostics`."""

from __future__ import annotations

from dataclasses import asdict

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.core.bridge_turns import SILENT_S
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.protocol.mapping import STATUS_NAMES
from hydro_msgs_docs.topics import IDLE, WAITING

OK, WARN, ERROR = "ok", "warn", "error"


def summary(
    core: BridgeCore, waiting_for: list[str], *, silent: bool, lacking: bool = False
) -> tuple[str, str]:
    """Level and one line.

    Parameters
    ----------
    core : BridgeCore
    waiting_for : list of str
        Topics that lack subscribers.
    silent : bool
        The device sent nothing for longer than it should.
    lacking : bool, optional
        It speaks, and no cycle was whole for as long.

    Returns
    -------
    level : {"ok", "warn", "error"}
    text : str
    """
    gate = core.gate
    if gate.state is GateState.TRIPPED:
        return ERROR, f"tripped: {gate.reason}"
    if gate.faults:
        return ERROR, next(iter(gate.faults.values()))
    if silent and not core.lockstep:
        return ERROR, "nothing from the device"
    if lacking:
        return ERROR, f"no whole cycle for {SILENT_S:g} s{_missing(core.assembler.missing)}"
    if not core.active:
        # In lockstep the machine stands still until it is answered, and may be silent.
        return (WARN, f"{IDLE[0]}: no device") if silent else (OK, f"{IDLE[0]}: reading")
    if silent:
        return WARN, f"{WAITING}the device"
    if not core.ready:
        # Where all are there: the core becomes ready with the next sample that they get.
        what = f"subscribers: {', '.join(waiting_for)}" if waiting_for else "the next sample"
        return WARN, WAITING + what
    if gate.state is GateState.WAITING:
        return WARN, f"{WAITING}a first command"
    return OK, "driving"


def _missing(frames: tuple[str, ...]) -> str:
    if not frames:
        return ""
    return f": frame{'s' if len(frames) > 1 else ''} {', '.join(frames)} missing"


def values(core: BridgeCore, bus: Bus, names: dict[str, str]) -> dict[str, object]:
    """What is published beside the summary.

    Parameters
    ----------
    core : BridgeCore
    bus : Bus
    names : dict
        Robot, mapping, calibration and the like.

    Returns
    -------
    dict
    """
    gate, sample = core.gate, core.sample
    return {
        **names,
        "clock": "lockstep" if core.lockstep else "real_time",
        "sample_zero_stamp_ns": core.clock.zero_stamp_ns,
        "sample_period_ns": core.clock.period_ns,
        "sample_counter": None if sample is None else sample.counter,
        **inputs(core),
        "gate": gate.state.value,
        "trip_reason": gate.reason,
        "trips": gate.trips,
        **{f"cycles_{key}": n for key, n in asdict(core.assembler.counters).items()},
        "cycles_read_late": core.read_late,
        **{f"commands_{key}": n for key, n in asdict(core.commands).items()},
        **{f"readings_{key}": n for key, n in asdict(core.watch.counters).items()},
        **{f"valve_frames_{key}": n for key, n in asdict(core.echo.counters).items()},
        "readings_last_fault": core.watch.newest,
        **{f"bus_{key}": n for key, n in asdict(bus.counters).items()},
        "bus_off": "yes" if bus.off else "no",
        "bus_last_error_frame": bus.last_error,
        "bus_load_percent": f"{100 * core.codec.layout.bus_load:.1f}",
    }


def inputs(core: BridgeCore) -> dict[str, object]:
    """The status bits of the newest cycle, driving or not: who presses a switch sees it.

    Parameters
    ----------
    core : BridgeCore

    Returns
    -------
    dict
        `input_emergency_stop_ok` and the like: "on" or "off"; None before the first cycle. Bits
        that the mapping leaves out are left out.
    """
    names = [name for name in STATUS_NAMES if name in core.codec.mapping.status]
    if core.sample is None:
        return {f"input_{name}": None for name in names}
    status = core.sample.readings.status
    return {f"input_{name}": "on" if getattr(status, name) else "off" for name in names}
