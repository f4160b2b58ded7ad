"""Segments from the entries of a joint path file, one reader per kind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hydro_model.description.fields import Fields
from hydro_model.errors import RobotError
from hydro_model.motion.paths_segments import Chirp, Cruise, Fourier, Hold, Quintic, Segment
from hydro_model.robot import FloatArray

#: No run of a crane is longer, and a typing slip in a duration is caught.
MAX_DURATION_S = 36_000.0


def read_segments(f: Fields, at: FloatArray) -> list[Segment]:
    """The segments of one entry of a path file.

    Parameters
    ----------
    f : Fields
        The entry; its `kind` says which.
    at : (k,) array
        Where the entry before ended.

    Returns
    -------
    list of Segment
        At least one, from rest at `at` to rest.

    Raises
    ------
    RobotError
        The entry is malformed.
    """
    kind = f.text("kind")
    if kind not in _KINDS:
        raise RobotError(f"{f.where}: 'kind' should be one of {', '.join(_KINDS)}, found '{kind}'")
    return _KINDS[kind](f, at)


def rectangle(f: Fields, key: str, width: int | None) -> FloatArray:
    """A list of rows of finite numbers, all of one width (that of the first where None).

    `f` are the fields of the path file.
    """
    wrapped = f.rows(key)
    size = len(wrapped[0]) if width is None and wrapped else width
    for index, row in enumerate(wrapped):
        if len(row) != size:
            raise RobotError(
                f"{f.where}: '{key}[{index}]' should have {size} numbers, found {len(row)}"
            )
    return np.array(wrapped, dtype=float).reshape(len(wrapped), size or 0)


def duration(f: Fields, key: str = "duration_s") -> float:
    """A time above 0 and below `MAX_DURATION_S`.

    `f` are the fields of the path file.
    """
    value = f.positive(key)
    if value > MAX_DURATION_S:
        raise RobotError(f"{f.where}: '{key}' should be at most {MAX_DURATION_S} s, found {value}")
    return value


def _move(f: Fields, at: FloatArray) -> list[Segment]:
    end = f.vector("to", len(at))
    return [Quintic.at_rest(at.tolist(), end.tolist(), duration(f))]


def _hold(f: Fields, at: FloatArray) -> list[Segment]:
    return [Hold(at, duration(f))]


def _ramp(f: Fields, duration_s: float) -> float:
    ramp = f.positive("ramp_s")
    if 2.0 * ramp > duration_s:
        raise RobotError(
            f"{f.where}: 'ramp_s' should be at most half of {duration_s:g} s, found {ramp}"
        )
    return ramp


def _cruise(f: Fields, at: FloatArray) -> list[Segment]:
    length = duration(f)
    return [Cruise(at, f.vector("to", len(at)) - at, _ramp(f, length), length)]


def _staircase(f: Fields, at: FloatArray) -> list[Segment]:
    move, hold = duration(f, "move_s"), duration(f, "hold_s")
    segments: list[Segment] = []
    for level in rectangle(f, "levels", len(at)):
        segments += [Quintic.at_rest(at.tolist(), level.tolist(), move), Hold(level, hold)]
        at = level
    if not segments:
        raise RobotError(f"{f.where}: 'levels' should have one level or more")
    return segments


def _ladder(f: Fields, at: FloatArray) -> list[Segment]:
    travel = f.vector("travel", len(at))
    ramp, hold = f.positive("ramp_s"), duration(f, "hold_s")
    distance = float(np.max(np.abs(travel)))
    segments: list[Segment] = []
    for speed in f.numbers("speeds"):
        if not 0.0 < speed * ramp <= distance:
            raise RobotError(
                f"{f.where}: a speed should be above 0 and reached within the travel of"
                f" {distance:g} (speed times ramp_s of {ramp:g} s), found {speed:g}"
            )
        length = distance / speed + ramp
        segments += [Cruise(at, travel, ramp, length), Hold(at + travel, hold)]
        segments += [Cruise(at + travel, -travel, ramp, length), Hold(at, hold)]
    if not segments:
        raise RobotError(f"{f.where}: 'speeds' should have one speed or more")
    return segments


def _fourier(f: Fields, at: FloatArray) -> list[Segment]:
    length = duration(f)
    sine = rectangle(f, "sine", None)
    cosine = rectangle(f, "cosine", sine.shape[1]) if "cosine" in f else np.zeros_like(sine)
    if sine.shape != cosine.shape or sine.shape[0] != len(at) or sine.size == 0:
        raise RobotError(
            f"{f.where}: 'sine' and 'cosine' should have {len(at)} rows of equal length,"
            f" found {sine.shape[0]} and {cosine.shape[0]}"
        )
    ramp = _ramp(f, length)
    return [Fourier(at, sine, cosine, f.positive("fundamental_hz"), ramp, length)]


def _chirp(f: Fields, at: FloatArray) -> list[Segment]:
    length = duration(f)
    amplitude = f.vector("amplitude", len(at))
    low, high = f.positive("from_hz"), f.positive("to_hz")
    return [Chirp(at, amplitude, low, high, _ramp(f, length), length)]


_KINDS: dict[str, Callable[[Fields, FloatArray], list[Segment]]] = {
    "move": _move,
    "hold": _hold,
    "cruise": _cruise,
    "staircase": _staircase,
    "ladder": _ladder,
    "fourier": _fourier,
    "chirp": _chirp,
}
