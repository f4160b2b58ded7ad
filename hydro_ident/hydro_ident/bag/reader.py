"""A bag from disk: a rosbag2 directory with MCAP storage, or a bare MCAP file.

Needs neither ROS nor an index. What is damaged or missing is a property of the result, in
words, beside what could be read.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from hydro_ident.bag.clock_restarts import continued
from hydro_ident.bag.decoder import Decoder
from hydro_ident.bag.diagnostics import Status
from hydro_ident.bag.log_kinds import instead_of_bag, instead_of_storage
from hydro_ident.bag.mcap_records import McapFile
from hydro_ident.bag.mcap_types import FileHealth, MessageBlock, unchecked
from hydro_ident.bag.nearby import bags_beside
from hydro_ident.bag.series import Series
from hydro_ident.errors import BagError
from hydro_model.command_line.terminal import advance
from hydro_model.description.safe_yaml import parse

METADATA_FILE = "metadata.yaml"
#: Name of the metadata record (and custom_data of metadata.yaml) of the project's own bags.
PROJECT_METADATA = "hydro"
_MAX_METADATA_BYTES = 16_000_000
#: A few thousand topics.
_MAX_METADATA_NODES = 100_000
#: What rosbag2 and other writers call no compression of whole files or messages, in any case.
_NOT_COMPRESSED = ("", "none")
_DIGITS = re.compile(r"([0-9]{1,18})")


@dataclass(slots=True)
class TopicInfo:
    """What a bag holds of one topic.

    Attributes
    ----------
    topic, message_type : str
    count : int
    first_log_ns, last_log_ns : int
        Earliest and latest reception.
    latency_ns : int
        Largest time from a message's publication to its reception.
    """

    topic: str
    message_type: str
    count: int = 0
    first_log_ns: int = 0
    last_log_ns: int = 0
    latency_ns: int = 0


@dataclass(frozen=True, slots=True)
class Bag:
    """A bag that was read.

    Attributes
    ----------
    path : Path
    files : tuple of FileHealth
        One per MCAP file, in order.
    topics : mapping of str to TopicInfo
        Every topic met.
    series : mapping of str to Series
        The topics that were asked for and have a type of `cdr.FIELDS`.
    metadata : mapping of str to str
        The project's own metadata (robot, mapping, note ...); empty for other people's bags.
    losses : tuple of str
        Everything that could not be read, in words; empty for a sound bag.
    diagnostics : tuple of Status
        What nodes said about themselves, in file order.
    """

    path: Path
    files: tuple[FileHealth, ...]
    topics: Mapping[str, TopicInfo]
    series: Mapping[str, Series]
    metadata: Mapping[str, str]
    losses: tuple[str, ...]
    diagnostics: tuple[Status, ...] = ()

    @property
    def count(self) -> int:
        """Number of messages of all topics."""
        return sum(info.count for info in self.topics.values())

    @property
    def unchecked(self) -> tuple[str, ...]:
        """What of it is under no checksum, in a line; none where every message is under one."""
        return unchecked(self.files)

    @property
    def checksummed(self) -> bool:
        """Every message was under a checksum that held."""
        return not self.unchecked

    @property
    def checksum_failed(self) -> bool:
        """Some checksum did not hold: bytes changed since they were written."""
        return any(f.checksum_failed for f in self.files)


def read_bag(path: str | Path, topics: Collection[str] | None = None) -> Bag:
    """Read a bag into columns.

    Parameters
    ----------
    path : str or Path
        A rosbag2 directory, or an MCAP file.
    topics : collection of str, optional
        Topics to decode; all by default. The others are counted only.

    Returns
    -------
    Bag

    Raises
    ------
    BagError
        Nothing there, no bag, a bag without a single message or of more than fits into memory;
        as `continued`.
    """
    path = Path(path)
    files, notes, metadata = files_of(path)
    infos: dict[str, TopicInfo] = {}
    decoder = Decoder(path, notes, diagnostics=True)
    healths = []
    for number, file in enumerate(files, 1):
        for block in file.blocks():
            what = f"reading file {number} of {len(files)}"
            advance(what, file.health.read_bytes, file.health.size_bytes)
            count_block(infos, block)
            if topics is None or block.channel.topic in topics:
                decoder.add(block)
        healths.append(file.health)
        metadata.update(file.metadata.get(PROJECT_METADATA, {}))
        notes += file.health.told
    if not infos:
        raise no_message(path, notes)
    series, restarts = continued(path, decoder.take())
    notes += restarts
    notes += malformed_notes({s.topic: (s.malformed, s.malformed_why) for s in series.values()})
    unique = tuple(dict.fromkeys(notes))
    return Bag(
        path,
        tuple(healths),
        dict(sorted(infos.items())),
        series,
        metadata,
        unique,
        tuple(decoder.statuses),
    )


def malformed_notes(malformed: Mapping[str, tuple[int, str]]) -> list[str]:
    """In words, what could not be decoded.

    Parameters
    ----------
    malformed : mapping of str to (int, str)
        By topic, how many messages and what was wrong with the first of them.
    """
    return [
        f"{topic}: {count} messages could not be decoded, first: {why}"
        for topic, (count, why) in malformed.items()
        if count
    ]


def no_message(path: Path, notes: Sequence[str]) -> BagError:
    """The error of a bag without a message.

    `notes` say what could not be read of `path`.
    """
    why = f" ({'; '.join(notes)})" if notes else ""
    return BagError(f"{path}: no message in this bag{why}")


def count_block(infos: dict[str, TopicInfo], block: MessageBlock) -> None:
    """Count a block of messages under its topic."""
    channel = block.channel
    first, last = int(block.log_ns.min()), int(block.log_ns.max())
    latency = int((block.log_ns - block.publish_ns).max())
    info = infos.get(channel.topic)
    if info is None:
        info = TopicInfo(channel.topic, channel.message_type, 0, first, last, latency)
        infos[channel.topic] = info
    info.count += len(block.offset)
    info.first_log_ns = min(info.first_log_ns, first)
    info.last_log_ns = max(info.last_log_ns, last)
    info.latency_ns = max(info.latency_ns, latency)


def files_of(path: Path) -> tuple[list[McapFile], list[str], dict[str, str]]:
    """The files of a bag in order.

    Parameters
    ----------
    path : Path
        A rosbag2 directory, or an MCAP file.

    Returns
    -------
    files : list of McapFile
    notes : list of str
        What is missing or odd about the directory.
    metadata : dict of str to str
        Custom data of metadata.yaml.

    Raises
    ------
    BagError
        Nothing there, or no bag.
    """
    if path.is_file():
        return [McapFile(path)], [], {}
    if not path.is_dir():
        expected = "expected a rosbag2 directory or an .mcap file"
        raise BagError(f"no bag '{path}': {expected}; {bags_beside(path)}")
    notes: list[str] = []
    names, metadata = _listed(path, notes)
    there = sorted((p.name for p in path.glob("*.mcap")), key=_by_number)
    if names is None:
        names = there
        if there:
            notes.append(f"no {METADATA_FILE} (a recording that was not closed)")
    names = list(dict.fromkeys(names))
    missing = [name for name in names if not (path / name).is_file()]
    notes += [f"{name}: named by {METADATA_FILE}, not there" for name in missing]
    # No error of its own: but a changed byte of one name makes it another's.
    others = [name for name in there if name not in names]
    present = [name for name in names if name not in missing]
    # Where nothing is there under its name the files were renamed.
    what = "left out" if present else "taken, as no file that it names is there"
    notes += [f"{name}: not named by {METADATA_FILE}, {what}" for name in others]
    present = present or others
    if not present:
        expected = "expected a rosbag2 directory with .mcap files, found none"
        raise BagError(f"{path}: {expected}{instead_of_bag(path)}")
    return [McapFile(path / name) for name in present], notes, metadata


def _by_number(name: str) -> list[tuple[int, str]]:
    """Orders `run_10.mcap` behind `run_9.mcap`, as they were written."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in _DIGITS.split(name)]


def _listed(path: Path, notes: list[str]) -> tuple[list[str] | None, dict[str, str]]:
    """File names and custom data of metadata.yaml; None where there is no usable one."""
    file = path / METADATA_FILE
    if not file.is_file():
        return None, {}
    information = _information(file, notes)
    if information is None:
        return None, {}
    storage = information.get("storage_identifier", "mcap")
    if storage != "mcap":
        other = instead_of_storage(path, str(storage))
        raise BagError(f"{path}: expected MCAP storage, found '{storage}'{other}")
    mode = str(information.get("compression_mode") or "")
    if mode.lower() not in _NOT_COMPRESSED:
        raise BagError(
            f"{path}: expected chunk compression, found whole {mode}"
            "s compressed by rosbag2: play or convert it with rosbag2 first"
        )
    listed = information.get("relative_file_paths")
    custom = information.get("custom_data")
    metadata = {str(k): str(v) for k, v in custom.items()} if isinstance(custom, dict) else {}
    if not isinstance(listed, list) or not listed:
        notes.append(f"{METADATA_FILE} names no files: every .mcap file of the directory taken")
        return None, metadata
    # Names only: a bag never reaches outside its own directory.
    return [PurePosixPath(str(name)).name for name in listed], metadata


def _information(file: Path, notes: list[str]) -> dict[str, Any] | None:
    try:
        if file.stat().st_size > _MAX_METADATA_BYTES:
            raise ValueError(f"larger than {_MAX_METADATA_BYTES} bytes")
        data = parse(file.read_text(encoding="utf-8"), _MAX_METADATA_NODES)
        information = data["rosbag2_bagfile_information"]
        if not isinstance(information, dict):
            raise TypeError("rosbag2_bagfile_information is no mapping")
    except (OSError, ValueError, TypeError, KeyError) as error:
        why = " ".join(str(error).split())
        notes.append(f"{METADATA_FILE} is not usable ({why}): every .mcap file taken")
        return None
    return information
