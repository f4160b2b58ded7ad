"""Files for RViz and robot_state_publisher: the view, and the parameters with the URDF in them."""

from __future__ import annotations

from typing import Any

import yaml

from hydro_model.robot import Robot
from hydro_msgs_docs.visual_urdf import base_link


def rviz_view(robot: Robot) -> str:
    """A configuration of RViz: grid, robot, frames; the camera looks along the first joint's axis.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    str
    """
    base = base_link(robot)
    reach = sum(float((j.translation_m**2).sum() ** 0.5) for j in robot.joints)
    reach += float((robot.tip_offset_m**2).sum() ** 0.5)
    topic = {"Value": "/robot_description", "Durability Policy": "Transient Local"}
    drawn = {"Description Source": "Topic", "Description Topic": topic}
    displays = [
        _display("Grid", "Grid", {"Cell Size": 0.5, "Plane Cell Count": 20}),
        _display("RobotModel", "Robot", drawn),
        _display("TF", "Frames", {"Marker Scale": 0.3, "Show Names": False}, enabled=False),
    ]
    camera = {
        "Class": "rviz_default_plugins/Orbit",
        "Name": "Side",
        "Distance": round(2.5 * max(reach, 0.4), 2),
        "Focal Point": {"X": round(0.4 * reach, 2), "Y": 0, "Z": round(0.2 * reach, 2)},
        "Pitch": 0.15,
        "Yaw": 4.71,
        "Target Frame": base,
    }
    tools = ["MoveCamera", "Interact", "Measure"]
    manager = {
        "Class": "",
        "Displays": displays,
        "Enabled": True,
        "Global Options": {"Fixed Frame": base, "Background Color": "255; 255; 255"},
        "Name": "root",
        "Tools": [{"Class": f"rviz_default_plugins/{tool}"} for tool in tools],
        "Value": True,
        "Views": {"Current": camera, "Saved": None},
    }
    panels = [{"Class": "rviz_common/Displays", "Name": "Displays"}]
    return str(yaml.safe_dump({"Panels": panels, "Visualization Manager": manager}))


def _display(
    kind: str, name: str, more: dict[str, Any], *, enabled: bool = True
) -> dict[str, Any]:
    plugin = f"rviz_default_plugins/{kind}"
    return {"Class": plugin, "Name": name, "Enabled": enabled, "Value": enabled} | more


class _Block(str):
    """A text that is written line by line."""


def _block(dumper: yaml.SafeDumper, text: _Block) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", str(text), style="|")


class _Dumper(yaml.SafeDumper):
    """A dumper of its own: the others keep theirs."""


_Dumper.add_representer(_Block, _block)


def state_publisher_parameters(urdf: str) -> str:
    """A ROS parameters file with the URDF for robot_state_publisher.

    Parameters
    ----------
    urdf : str

    Returns
    -------
    str
    """
    parameters = {"robot_description": _Block(urdf), "publish_frequency": 50.0}
    content = {"robot_state_publisher": {"ros__parameters": parameters}}
    return str(yaml.dump(content, Dumper=_Dumper, width=10_000, sort_keys=False))
