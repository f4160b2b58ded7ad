"""Stamped, named vectors as JointState messages, and stamps as integers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

VECTOR_FIELDS = ("position", "velocity", "effort")
_SECOND_NS = 1_000_000_000


def stamp_ns(message: Any) -> int:
    """The header stamp of a message in nanoseconds."""
    stamp = message.header.stamp
    return int(stamp.sec) * _SECOND_NS + int(stamp.nanosec)


def set_stamp(message: Any, stamp: int) -> None:
    """Write a stamp in nanoseconds into a message's header."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, _SECOND_NS)


def joint_state(
    stamp: int,
    names: Sequence[str],
    *,
    position: Sequence[float] = (),
    velocity: Sequence[float] = (),
    effort: Sequence[float] = (),
) -> Any:
    """A `sensor_msgs/msg/JointState` used as a stamped, named vector.

    Parameters
    ----------
    stamp : int
        Nanoseconds of ROS time.
    names : sequence of str
    position, velocity, effort : sequence of float
        Empty, or one value per name; units as the topic's page says.

    Returns
    -------
    sensor_msgs.msg.JointState
    """
    from sensor_msgs.msg import JointState

    message = JointState()
    set_stamp(message, stamp)
    message.name = list(names)
    message.position = list(position)
    message.velocity = list(velocity)
    message.effort = list(effort)
    return message


@dataclass(frozen=True, slots=True)
class StampedVector:
    """What a `sensor_msgs/msg/JointState` says, its fields under their names there.

    Attributes
    ----------
    stamp_ns : int
        Nanoseconds of ROS time.
    name : tuple of str
    position, velocity, effort : tuple of float
        Units as the topic's page says. As the sender made them: empty, or one value per name,
        or any other number.
    """

    stamp_ns: int
    name: tuple[str, ...] = ()
    position: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    effort: tuple[float, ...] = ()

    @classmethod
    def of(cls, message: Any) -> StampedVector:
        """From a message.

        Parameters
        ----------
        message : sensor_msgs.msg.JointState
        """
        lists = (tuple(getattr(message, name)) for name in VECTOR_FIELDS)
        return cls(stamp_ns(message), tuple(message.name), *lists)


def by_name(message: Any, field: str, names: Sequence[str]) -> list[float] | None:
    """The values of one field in the order of `names`, or None where one is not there.

    Parameters
    ----------
    message : sensor_msgs.msg.JointState or StampedVector
    field : {"position", "velocity", "effort"}
    names : sequence of str

    Returns
    -------
    list of float or None
    """
    values = getattr(message, field)
    if list(message.name) == list(names) and len(values) == len(names):
        return [float(v) for v in values]
    at = {name: i for i, name in enumerate(message.name)}
    if any(name not in at or at[name] >= len(values) for name in names):
        return None
    return [float(values[at[name]]) for name in names]
