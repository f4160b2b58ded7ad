"""Runs of the study as bags of the contract, with nothing in them that a crane would not say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hydro_hw_bridge.rig.readings import read_pressures
from hydro_ident.bag.provenance import software_version
from hydro_ident.bag.writer import BagWriter
from hydro_ident.study.traces import Drive
from hydro_model.arrays import FloatArray, IntArray
from hydro_msgs_docs.cdr import JOINT_STATE, TEMPERATURE, encode, layout_of
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    JOINT_STATES,
    OIL_TEMPERATURE,
    VALVE_COMMAND,
    VALVE_STATE,
)

_SECOND_NS = 1_000_000_000
#: Recordings lie anywhere within this many seconds from the first of them.
FIRST_S, SPAN_S = 1_767_225_600, 10_000_000


def write_run(
    folder: Path, run: Drive, *, seed: int, start_ns: int, temperature_c: FloatArray | None
) -> None:
    """Write a run as a bag.

    Parameters
    ----------
    folder : Path
        Of the bag; must not exist.
    run : Drive
    seed : int
        Of the pressures' noise.
    start_ns : int
        First stamp.
    temperature_c : (T,) array, optional
        Oil temperature once a second.
    """
    robot, track = run.machine.robot, run.track
    cycle_ns = round(track.cycle_s * _SECOND_NS)
    pressures = read_pressures(run.plant, track, seed) + robot.atmospheric_pressure_pa
    names = robot.pressure_names
    if not run.machine.lines_recorded:
        names, pressures = names[:-2], pressures[:, :-2]
    order = [[c.name for c in robot.cylinders].index(v.cylinder) for v in robot.valves]
    rated = np.array([v.rated_voltage_v for v in robot.valves])
    volts = track.commands[:, order] * rated
    speed = np.zeros_like(track.seen)
    speed[1:] = np.diff(track.seen, axis=0) / track.cycle_s
    columns = (
        (JOINT_STATES, robot.joint_names, {"position": track.seen, "velocity": speed}),
        (CHAMBER_PRESSURES, names, {"effort": pressures}),
        (VALVE_COMMAND, robot.valve_names, {"effort": volts}),
        (VALVE_STATE, robot.valve_names, {"effort": volts}),
    )
    metadata = {"robot": robot.name, "software": software_version(), "note": ""}
    every, stamps = round(1.0 / track.cycle_s), start_ns + cycle_ns * np.arange(len(volts))
    encoded = [(topic, *_encoded(names, stamps, values)) for topic, names, values in columns]
    with BagWriter(folder, metadata) as writer:
        for topic, _, _ in columns:
            writer.add_topic(topic, JOINT_STATE)
        if temperature_c is not None:
            writer.add_topic(OIL_TEMPERATURE, TEMPERATURE)
        for k in range(len(volts)):
            stamp = int(stamps[k])
            for topic, data, size in encoded:
                writer.write(topic, data[k * size : (k + 1) * size], stamp)
            if temperature_c is not None and k % every == 0:
                reading = {"temperature": round(float(temperature_c[k // every]), 1)}
                writer.write_stamped(OIL_TEMPERATURE, stamp, reading)


def _encoded(
    names: tuple[str, ...], stamps: IntArray, values: Mapping[str, FloatArray]
) -> tuple[bytes, int]:
    """Messages of a topic one after the other, and the size of each: all are laid out alike."""
    first = encode(JOINT_STATE, int(stamps[0]), {f: v[0] for f, v in values.items()}, names=names)
    rows = np.tile(np.frombuffer(first, dtype=np.uint8), (len(stamps), 1))
    # Behind the encapsulation: the stamp's seconds and nanoseconds.
    for begin, numbers in ((4, stamps // _SECOND_NS), (8, stamps % _SECOND_NS)):
        rows[:, begin : begin + 4] = numbers.astype("<u4")[:, None].view(np.uint8)
    offsets = layout_of(first, JOINT_STATE).values
    for field, array in values.items():
        begin, count = offsets[field]
        numbers = np.ascontiguousarray(array, dtype="<f8")
        rows[:, begin : begin + 8 * count] = numbers.view(np.uint8).reshape(len(stamps), -1)
    return rows.tobytes(), len(first)
