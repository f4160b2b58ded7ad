"""Which topics the recorder takes, and of which types."""

from __future__ import annotations

from collections.abc import Sequence

from hydro_ident.bag.definitions import message_class_of
from hydro_ident.errors import BagError
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import FLUID_PRESSURE
from hydro_msgs_docs.topics import MESSAGE_TYPES


def wanted_topics(asked: Sequence[str] | None, robot: Robot) -> dict[str, str]:
    """Topics to record and their types.

    Parameters
    ----------
    asked : sequence of str, or None
        `TOPIC` of the contract or `TOPIC:TYPE`; None for everything of the contract.
    robot : Robot
        Its cylinders name the `/pressure` topics.

    Returns
    -------
    dict of str to str

    Raises
    ------
    BagError
        A topic whose type is neither known nor given.
    """
    pressures = {f"/pressure/{c.name}/{s}": FLUID_PRESSURE for c in robot.cylinders for s in "ab"}
    known = {**MESSAGE_TYPES, **pressures}
    if asked is None:
        return known
    topics = {}
    for entry in asked:
        name, _, kind = entry.partition(":")
        topic = name if name.startswith("/") else f"/{name}"
        if not kind and topic not in known:
            raise BagError(
                f"unknown topic {topic}: expected one of {', '.join(known)}, or TOPIC:TYPE"
            )
        topics[topic] = kind or known[topic]
    return topics


def check_topic(topic: str, message_type: str) -> None:
    """Refuse with BagError what is no topic name, and a type that is not installed.

    `message_type` as in `sensor_msgs/msg/JointState`.
    """
    from rclpy.exceptions import InvalidTopicNameException
    from rclpy.validate_full_topic_name import validate_full_topic_name

    try:
        validate_full_topic_name(topic)
        message_class_of(message_type)
    except InvalidTopicNameException as error:
        raise BagError(f"'{topic}' is no topic name: {' '.join(str(error).split())}") from error
    except LookupError as error:
        raise BagError(str(error)) from error
