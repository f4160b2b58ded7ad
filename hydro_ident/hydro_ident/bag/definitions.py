"""Message definitions that go into a bag as ros2msg text, and the hashes of their types.

The definitions are those of common_interfaces 5.3 (Jazzy) without comments, so that bags can be
written where no ROS is installed. Hashes are RIHS01 (REP-2016).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_SEPARATOR = "=" * 80

DEFINITIONS: Mapping[str, str] = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    ),
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/PointStamped": "std_msgs/Header header\ngeometry_msgs/Point point\n",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort\n"
    ),
    "sensor_msgs/FluidPressure": (
        "std_msgs/Header header\nfloat64 fluid_pressure\nfloat64 variance\n"
    ),
    "sensor_msgs/Temperature": ("std_msgs/Header header\nfloat64 temperature\nfloat64 variance\n"),
    "trajectory_msgs/JointTrajectoryPoint": (
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n"
        "float64[] effort\nbuiltin_interfaces/Duration time_from_start\n"
    ),
    "trajectory_msgs/JointTrajectory": (
        "std_msgs/Header header\nstring[] joint_names\n"
        "trajectory_msgs/JointTrajectoryPoint[] points\n"
    ),
    "trajectory_msgs/MultiDOFJointTrajectoryPoint": (
        "geometry_msgs/Transform[] transforms\ngeometry_msgs/Twist[] velocities\n"
        "geometry_msgs/Twist[] accelerations\nbuiltin_interfaces/Duration time_from_start\n"
    ),
    "trajectory_msgs/MultiDOFJointTrajectory": (
        "std_msgs/Header header\nstring[] joint_names\n"
        "trajectory_msgs/MultiDOFJointTrajectoryPoint[] points\n"
    ),
    "diagnostic_msgs/KeyValue": "string key\nstring value\n",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\n"
        "string message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n"
    ),
    "diagnostic_msgs/DiagnosticArray": (
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n"
    ),
}

TYPE_HASHES: Mapping[str, str] = {
    "sensor_msgs/msg/JointState": (
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    ),
    "geometry_msgs/msg/PointStamped": (
        "RIHS01_4c0296af86e01e562e9e0405d138a01537247580076c58ea38d7923ac1045897"
    ),
    "sensor_msgs/msg/FluidPressure": (
        "RIHS01_22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32"
    ),
    "sensor_msgs/msg/Temperature": (
        "RIHS01_72514a14126ab9f8a9abec974c78e5610a367b59db5da355ff1fb982d5bad4b8"
    ),
    "trajectory_msgs/msg/JointTrajectory": (
        "RIHS01_179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e"
    ),
    "trajectory_msgs/msg/MultiDOFJointTrajectory": (
        "RIHS01_3a18fd095292a65cfde8833c72985a30af981f3ec44494655c6267262b443a4a"
    ),
    "diagnostic_msgs/msg/DiagnosticArray": (
        "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
    ),
}


def definition(message_type: str, texts: Mapping[str, str] = DEFINITIONS) -> str:
    """The full text of a message type with everything it is made of.

    Parameters
    ----------
    message_type : str
        `package/msg/Name`.
    texts : mapping of str to str
        Definitions by `package/Name`.

    Returns
    -------
    str
        The type's own text, then each dependency behind a line of 80 `=` and `MSG: name`.

    Raises
    ------
    KeyError
        The type, or one it is made of, is not in `texts`.
    """
    name = message_type.replace("/msg/", "/")
    parts = [texts[name]]
    pending, seen = _dependencies(texts[name]), {name}
    while pending:
        dependency = pending.pop(0)
        if dependency not in seen:
            seen.add(dependency)
            parts.append(f"{_SEPARATOR}\nMSG: {dependency}\n{texts[dependency]}")
            pending += _dependencies(texts[dependency])
    return "".join(parts)


def _dependencies(text: str) -> list[str]:
    kinds = (line.split()[0].split("[")[0] for line in text.splitlines() if line.strip())
    return [kind for kind in kinds if "/" in kind]


def definition_of_class(message_class: Any) -> str:
    """The full text of any installed message type, from its Python class.

    Parameters
    ----------
    message_class : type
        A generated message class.

    Returns
    -------
    str
        As `definition`; constants and defaults, which no byte depends on, are left out.
    """
    texts: dict[str, str] = {}
    top = _class_name(message_class)
    pending = [message_class]
    while pending:
        current = pending.pop()
        name = _class_name(current)
        if name in texts:
            continue
        lines = []
        for field, kind in current.get_fields_and_field_types().items():
            base, suffix = _ros2msg_type(kind)
            lines.append(f"{base}{suffix} {field}\n")
            if "/" in base:
                pending.append(message_class_of(base.replace("/", "/msg/")))
        texts[name] = "".join(lines)
    return definition(top, texts)


def _class_name(message_class: Any) -> str:
    return f"{message_class.__module__.split('.')[0]}/{message_class.__name__}"


def _ros2msg_type(kind: str) -> tuple[str, str]:
    """`sequence<double, 3>` and the like as ros2msg base type and suffix."""
    suffix = ""
    if kind.startswith("sequence<"):
        base, _, bound = kind[len("sequence<") : -1].partition(", ")
        suffix = f"[<={bound}]" if bound else "[]"
    else:
        base, _, size = kind.partition("[")
        suffix = f"[{size}" if size else ""
    base, _, length = base.partition("<")
    renamed = {"double": "float64", "float": "float32", "boolean": "bool", "octet": "byte"}
    base = renamed.get(base, base)
    return (f"{base}<={length[:-1]}" if length else base), suffix


def message_class_of(message_type: str) -> Any:
    """The generated class of `package/msg/Name`.

    Parameters
    ----------
    message_type : str

    Returns
    -------
    type

    Raises
    ------
    LookupError
        No such type is installed.
    """
    from importlib import import_module

    package, _, name = message_type.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise LookupError(f"no message type '{message_type}' installed") from error
