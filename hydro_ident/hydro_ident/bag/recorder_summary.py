"""What a recorder says at its end of what it has recorded, to a person and to a program."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from hydro_ident.bag.writer import BagWriter

SCHEMA = "hydro_ident/recorded/1"
#: A disk that takes longer for a chunk falls behind.
SLOW_S = 0.2


def nothing_heard() -> str:
    """Why nothing may have come, and what to look at."""
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    return f"nothing was received: are the nodes up, and in this ROS domain ({domain})?"


def summary(writer: BagWriter, lost: Mapping[str, int], seconds: float) -> str:
    """What was recorded, a line per topic.

    Parameters
    ----------
    writer : BagWriter
        Closed.
    lost : mapping of str to int
        How many messages of each topic were lost before the recorder.
    seconds : float
        How long it recorded.

    Returns
    -------
    str
    """
    counts = {topic: count for topic, count in sorted(writer.counts.items()) if count}
    lines = [f"recorded {sum(counts.values())} messages in {seconds:.1f} s: {writer.directory}"]
    if not counts:
        lines.append(f"  {nothing_heard()}")
    for topic, count in counts.items():
        gone = f"  {lost[topic]} LOST before the recorder" if lost.get(topic) else ""
        lines.append(f"  {count:9d}  {topic}{gone}")
    if writer.slowest_s > SLOW_S:
        lines.append(f"  the disk took up to {writer.slowest_s:.1f} s for a chunk")
    return "\n".join(lines)


def summary_dict(writer: BagWriter, lost: Mapping[str, int], seconds: float) -> dict[str, Any]:
    """The same for `--json`.

    Parameters
    ----------
    writer : BagWriter
        Closed.
    lost : mapping of str to int
    seconds : float

    Returns
    -------
    dict
        `topics` has the topics of which something was received; `bytes` is the size of the bag.
    """
    counts = {topic: count for topic, count in sorted(writer.counts.items()) if count}
    return {
        "schema": SCHEMA,
        "bag": str(writer.directory),
        "seconds": seconds,
        "messages": sum(counts.values()),
        "lost": sum(lost.values()),
        "bytes": sum(f.stat().st_size for f in writer.directory.iterdir() if f.is_file()),
        "slowest_chunk_s": writer.slowest_s,
        "topics": {t: {"messages": n, "lost": lost.get(t, 0)} for t, n in counts.items()},
    }
