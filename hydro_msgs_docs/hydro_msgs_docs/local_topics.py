"""How far topics reach: this computer, unless somebody says otherwise."""

from __future__ import annotations

import os

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCAL = "LOCALHOST"


def stay_local() -> None:
    """Keep topics on this computer unless the environment names a range; before `rclpy.init`.

    ROS itself would look for others in the whole subnet, and whoever is found may command valves.
    """
    os.environ.setdefault(RANGE, LOCAL)
