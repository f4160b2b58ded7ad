"""metadata.yaml of a rosbag2 directory, version 9 (Jazzy), and the QoS that publishers offered."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from hydro_ident.errors import BagError

VERSION = 9
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_ENDLESS = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True, slots=True)
class OfferedQos:
    """What a topic's publisher offered, in rosbag2's words.

    Attributes
    ----------
    depth : int
    reliability, durability, history : str
    """

    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"

    def mapping(self) -> dict[str, Any]:
        """As it stands in metadata.yaml and in a channel's metadata."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": dict(_ENDLESS),
            "lifespan": dict(_ENDLESS),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_ENDLESS),
            "avoid_ros_namespace_conventions": False,
        }


@dataclass(slots=True)
class TopicRecord:
    """One topic of a bag being written.

    Attributes
    ----------
    topic, message_type, type_hash : str
    qos : sequence of OfferedQos
    count : int
    """

    topic: str
    message_type: str
    type_hash: str
    qos: Sequence[OfferedQos]
    count: int = 0


@dataclass(slots=True)
class FileRecord:
    """One MCAP file of a bag being written.

    Attributes
    ----------
    name : str
    first_ns, last_ns : int
        Earliest and latest log time; 0 while empty.
    count : int
    """

    name: str
    first_ns: int = 0
    last_ns: int = 0
    count: int = 0

    def add(self, log_ns: int) -> None:
        """Count a message."""
        self.first_ns = min(self.first_ns, log_ns) if self.count else log_ns
        self.last_ns = max(self.last_ns, log_ns) if self.count else log_ns
        self.count += 1

    def span(self) -> dict[str, Any]:
        """Starting time, duration and count as they stand in metadata.yaml."""
        return {
            "starting_time": {"nanoseconds_since_epoch": self.first_ns},
            "duration": {"nanoseconds": self.last_ns - self.first_ns},
            "message_count": self.count,
        }


def bag_directory(out: str | Path, name: str, now: time.struct_time | None = None) -> Path:
    """The directory of a new bag, `OUT/YYYYMMDD-HHMMSS_NAME`.

    Parameters
    ----------
    out : str or Path
    name : str
        Letters, digits, dot, dash, underscore.
    now : time.struct_time, optional
        Local time by default.

    Returns
    -------
    Path

    Raises
    ------
    BagError
        A name that would not make a directory's name.
    """
    if not _NAME.fullmatch(name):
        raise BagError(f"expected a bag name of letters, digits, '.', '-' and '_', found '{name}'")
    stamp = time.strftime("%Y%m%d-%H%M%S", now or time.localtime())
    return Path(out) / f"{stamp}_{name}"


def qos_text(qos: Sequence[OfferedQos]) -> str:
    """Offered QoS profiles as the YAML text of a channel's metadata."""
    return _dump([profile.mapping() for profile in qos])


def metadata_text(
    files: Sequence[FileRecord], topics: Sequence[TopicRecord], custom: Mapping[str, str]
) -> str:
    """The text of metadata.yaml.

    Parameters
    ----------
    files : sequence of FileRecord
    topics : sequence of TopicRecord
    custom : mapping of str to str
        The project's own metadata.

    Returns
    -------
    str
    """
    whole = FileRecord("")
    for file in files:
        if file.count:
            whole.add(file.first_ns)
            whole.add(file.last_ns)
    whole.count = sum(file.count for file in files)
    information = {
        "version": VERSION,
        "storage_identifier": "mcap",
        **whole.span(),
        "topics_with_message_count": [_topic(record) for record in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **file.span()} for file in files],
        "custom_data": dict(custom) or None,
        "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
    }
    return _dump({"rosbag2_bagfile_information": information})


def _topic(record: TopicRecord) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": record.topic,
            "type": record.message_type,
            "serialization_format": "cdr",
            "offered_qos_profiles": [profile.mapping() for profile in record.qos],
            "type_description_hash": record.type_hash,
        },
        "message_count": record.count,
    }


class _NoAliases(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def _dump(data: object) -> str:
    text = yaml.dump(data, Dumper=_NoAliases, sort_keys=False, default_flow_style=False)
    return str(text)
