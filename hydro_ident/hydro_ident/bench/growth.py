"""How time and memory of the streaming commands grow with the length of a bag.

`inspect` and `identify` read it, `player` plays it at a multiple of real time, and `recorder`
records what is played. `diagnose` is beside them, up to ten minutes: its memory may grow as its
time does.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hydro_ident.bench.job import Row
from hydro_ident.bench.processes import Processes, cpu_s, entry
from hydro_ident.errors import IdentError
from hydro_ident.study.long_bag import ROBOT, bag_of, watched
from hydro_ident.study.peak import status_kb

#: Commands that read a bag as fast as they can, and what counts as their time.
READERS, WALL = ("inspect", "identify"), "time"
#: Reads a bag several times and holds what it needs of it: of bags up to so many minutes.
HELD, HELD_MINUTES = "diagnose", 10.0
#: Commands through which a bag passes at its own pace, and what counts there.
LIVE, CPU = ("recorder", "player"), "processor time"
#: Times real time: 10 000 messages a second. At twice that some of a million were lost.
SPEED = 5.0
#: Largest exponents: time linear in the length, memory a quarter more at a hundred times as much.
LINEAR, FLAT = 1.0, 0.05
#: Share of the messages that may be lost: they are counted, and more would tell of a smaller bag.
MOST_LOST, LOST = 1.0e-3, "share of the messages not recorded"
#: Until both know each other, and until the recorder has what is on its way, s.
_MEET_S, _SETTLE_S, _PATIENCE_S = 3.0, 1.0, 60.0
_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class Grown:
    """A command and a bag.

    Attributes
    ----------
    minutes : float
        Length of the bag.
    seconds : float
        From start to end, or of a processor's time where it keeps the bag's pace.
    peak_mb : float
        Largest resident memory, MiB.
    """

    minutes: float
    seconds: float
    peak_mb: float


@dataclass(frozen=True, slots=True)
class Passed:
    """A bag that was played and recorded again.

    Attributes
    ----------
    used : mapping of str to (float, float)
        By name of `LIVE`: processor time in s, and peak memory in MiB.
    played, recorded : int
        Messages.
    """

    used: Mapping[str, tuple[float, float]]
    played: int
    recorded: int


def growth_rows(minutes: Sequence[float], folder: Path) -> Iterator[Row]:
    """Exponents of time and of peak memory of every streaming command over a bag's length.

    Parameters
    ----------
    minutes : sequence of float
        At least two lengths.
    folder : Path
        Where the bags go for a while.

    Yields
    ------
    Row
        The limits are `LINEAR`, `FLAT` and `MOST_LOST`; what falls keeps them whatever it is.

    Raises
    ------
    IdentError
        A command failed.
    """
    read, passed = [], []
    for length in minutes:
        bag = bag_of(length, folder)
        read.append(_read(bag, length))
        passed.append(passed_on(bag, folder / f"live_{length:g}"))
        shutil.rmtree(bag)
    for command in READERS:
        yield from exponent_rows(command, [one[command] for one in read])
    for command in LIVE:
        used = zip(minutes, (one.used[command] for one in passed), strict=True)
        yield from exponent_rows(command, [Grown(length, *one) for length, one in used])
    yield lost_row(minutes, passed)
    if len(held := [one[HELD] for one in read if HELD in one]) > 1:
        yield from exponent_rows(HELD, held)


def lost_row(minutes: Sequence[float], passed: Sequence[Passed]) -> Row:
    """How many of the messages that were played were not recorded, against `MOST_LOST`.

    Parameters
    ----------
    minutes : sequence of float
    passed : sequence of Passed
        Of these lengths.
    """
    played = sum(one.played for one in passed)
    share = (played - sum(one.recorded for one in passed)) / played
    job = f"recorder, bags of {min(minutes):g} to {max(minutes):g} minutes: {LOST}"
    ratio = MOST_LOST / max(share, 0.01 * MOST_LOST)
    return Row(job, f"{MOST_LOST:g}", share, MOST_LOST, ratio, 1.0, rounds=1)


def exponent_rows(command: str, grown: Sequence[Grown]) -> Iterator[Row]:
    """Exponents over all lengths, and over the last decade where there is more than that.

    Over all lengths a command's start, which does not grow, hides how the rest does.

    Parameters
    ----------
    command : str
    grown : sequence of Grown
        At least two lengths.
    """
    longest = max(one.minutes for one in grown)
    last = [one for one in grown if one.minutes >= 0.0999 * longest]
    for some in [grown, last] if 1 < len(last) < len(grown) else [grown]:
        lengths = [one.minutes for one in some]
        span = f"{min(lengths):g} to {longest:g} minutes"
        for name, values, most in (
            (CPU if command in LIVE else WALL, [one.seconds for one in some], LINEAR),
            ("peak memory", [one.peak_mb for one in some], LINEAR if command == HELD else FLAT),
        ):
            found = exponent(lengths, values)
            ratio = most / max(found, 0.01 * most)
            job = f"{command}, a bag of {span}: exponent of {name}"
            peer = "linear" if most == LINEAR else "flat"
            yield Row(job, peer, found, most, ratio, 1.0, rounds=1)


def exponent(lengths: Sequence[float], values: Sequence[float]) -> float:
    """Slope of the logarithm of values over that of lengths, by least squares.

    Parameters
    ----------
    lengths, values : sequence of float
        Above 0.
    """
    return float(np.polyfit(np.log(lengths), np.log(values), 1)[0])


def _read(bag: Path, minutes: float) -> dict[str, Grown]:
    """What every command that reads a bag needs for one of this length."""
    held = (HELD,) if minutes <= HELD_MINUTES else ()
    spent = {command: watched(command, bag) for command in (*READERS, *held)}
    return {command: Grown(minutes, one.seconds, one.peak_mb) for command, one in spent.items()}


def passed_on(bag: Path, folder: Path) -> Passed:
    """Play a bag, and record what is played.

    Parameters
    ----------
    bag : Path
    folder : Path
        For the record and what both say; removed again.

    Returns
    -------
    Passed

    Raises
    ------
    IdentError
        A process failed.
    """
    folder.mkdir()
    processes, told = Processes(folder), {name: folder / f"{name}.json" for name in LIVE}
    words = {
        "recorder": ["--out", str(folder), "--robot", ROBOT],
        "player": [str(bag), "--rate", f"{SPEED:g}", "--delay", f"{_MEET_S:g}"],
    }
    used: dict[str, tuple[float, float]] = {}
    try:
        for name in LIVE:
            how = [*entry(f"hydro_ident.bag.{name}"), *words[name], "--json", str(told[name])]
            processes.start(name, how)
            if name == "recorder":
                _until_it_records(processes)
        while processes.by_name["player"].poll() is None:
            used |= _used(processes)
            time.sleep(_POLL_S)
        time.sleep(_SETTLE_S)
        used |= _used(processes)
        processes.by_name["recorder"].terminate()
        processes.by_name["recorder"].wait(_PATIENCE_S)
    finally:
        processes.stop()
    recorded, played = _messages(told, processes)
    shutil.rmtree(folder)
    return Passed(used, played, recorded)


def _until_it_records(processes: Processes) -> None:
    """Wait until the recorder says so; what it says instead is the error."""
    end = time.monotonic() + _PATIENCE_S
    while "recording" not in (said := processes.last_words()):
        if processes.by_name["recorder"].poll() is not None or time.monotonic() > end:
            raise IdentError(f"growth: the recorder does not begin: {said or 'it says nothing'}")
        time.sleep(_POLL_S)


def _used(processes: Processes) -> dict[str, tuple[float, float]]:
    """Processor time and peak memory of those that run."""
    used = {}
    for name, process in processes.by_name.items():
        peak_kb = status_kb(process.pid, "VmHWM")
        if peak_kb:
            used[name] = cpu_s(process.pid), peak_kb / 1024.0
    return used


def _messages(told: Mapping[str, Path], processes: Processes) -> tuple[int, int]:
    """How many were recorded and played, by what both say at their end."""
    if not all(file.is_file() for file in told.values()):
        raise IdentError(f"growth: {processes.last_words()}")
    recorded, played = (json.loads(told[name].read_text("utf-8"))["messages"] for name in LIVE)
    return recorded, played
