"""What every node asks of the middleware before it starts: reach, and prompt repair."""

from __future__ import annotations

import os
from pathlib import Path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCAL = "LOCALHOST"
#: Where Fast DDS looks for settings of its own, and ours.
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILES_FILE = Path(__file__).with_name("fastdds.xml")


def prepare_middleware() -> None:
    """Set what the environment leaves open; before `rclpy.init`.

    Topics are kept on this computer: ROS itself would look for others in the whole subnet, and
    whoever is found may command valves. Publishers say every 0.1 s what they have sent, so that
    a subscriber asks again that soon for what it missed; Fast DDS itself would say it every 3 s,
    and until then a reliable topic stands still.
    """
    os.environ.setdefault(RANGE, LOCAL)
    os.environ.setdefault(PROFILES, str(PROFILES_FILE))
