"""Golden bags through the real controller core and the real diagnosis, as plain values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hydro_control.adaptation.adaptation_settings import KINDS, AdaptationSettings
from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_control.state.sample import Sample
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import RECORDING_TOPICS, Recording, recording_of
from hydro_ident.errors import IdentError
from hydro_ident.identify.origin import provenance
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.diagnosis_file import result_dict
from hydro_ident.recordings.sources import bag_source
from hydro_ident.study.golden.bags import CONTROL_BAG, DELAY_S, DIAGNOSIS_BAG, PATH, ROBOT
from hydro_model.robot_files import load_robot

#: Every so many answers are kept, and of the numbers so many digits.
_EVERY, _DIGITS = 5, 12


def control(folder: Path) -> dict[str, Any]:
    """Every answer to a bag, of a controller as it is shipped and of one that adapts.

    Parameters
    ----------
    folder : Path
        Of the golden files.
    """
    robot = load_robot(ROBOT)
    recording = recording_of(read_bag(folder / CONTROL_BAG, RECORDING_TOPICS), robot)
    adapting = AdaptationSettings(KINDS)
    return {
        "shipped": _answers(ControllerCore(robot, Gains(), PATH, DELAY_S), recording),
        "adapting": _answers(
            ControllerCore(robot, Gains(), PATH, DELAY_S, adaptation=adapting), recording
        ),
    }


def _answers(core: ControllerCore, recording: Recording) -> dict[str, Any]:
    rows = []
    for k, stamp in enumerate(recording.stamp_ns.tolist()):
        answer = core.answer(_sample(core, recording, k, stamp))
        if answer is None:
            raise IdentError(f"expected an answer at {stamp} ns, found none")
        if recording.valve_v is not None:
            core.applied(stamp, recording.valve_v[k])
        if k % _EVERY == 0:
            rows.append(_row(core, stamp, answer.output))
    counts = core.counts
    return {
        "answers": rows,
        "message": core.message,
        "counts": {name: getattr(counts, name) for name in counts.__slots__},
    }


def _sample(core: ControllerCore, recording: Recording, k: int, stamp: int) -> Sample:
    if recording.p_a is None or recording.p_b is None:
        raise IdentError(f"{recording.path}: expected pressures of all chambers, found them not")
    atmosphere = core.robot.atmospheric_pressure_pa
    lines = [
        None if line is None else float(line[k]) + atmosphere
        for line in (recording.supply, recording.tank)
    ]
    chambers = recording.p_a[k] + atmosphere, recording.p_b[k] + atmosphere
    return Sample(stamp, recording.q[k], *chambers, lines[0], lines[1])


def _row(core: ControllerCore, stamp: int, output: Any) -> dict[str, Any]:
    """An answer's fields."""
    row: dict[str, Any] = {"stamp_ns": stamp}
    for name in output.__slots__:
        value = getattr(output, name)
        row[name] = _listed(value) if isinstance(value, np.ndarray) else value
    row["notes"] = list(output.notes)
    adaptation = core.law.adaptation
    row["estimates"] = [] if adaptation is None else _listed(adaptation.estimates)
    return row


def _listed(values: Any) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def diagnosis(folder: Path) -> dict[str, Any]:
    """What `diagnose` writes of a bag, without what names files, versions and commands.

    Parameters
    ----------
    folder : Path
        Of the golden files.
    """
    robot, bag = load_robot(ROBOT), folder / DIAGNOSIS_BAG
    found = diagnose(robot, [bag_source(str(bag), robot)], [])
    result = result_dict(found, provenance("golden", ROBOT, {bag.name: bag}, {}))
    del result["provenance"]
    return result


REPLAYS = {"control": control, "diagnosis": diagnosis}
