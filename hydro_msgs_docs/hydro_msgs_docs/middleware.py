"""What every node asks of the middleware before it starts: reach, and prompt repair."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

from hydro_msgs_docs.aside import ROSOUT_ALONE
from hydro_msgs_docs.errors import ContractError

DOMAIN = "ROS_DOMAIN_ID"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCAL = "LOCALHOST"
#: Where Fast DDS looks for settings of its own, and ours.
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILES_FILE = Path(__file__).with_name("fastdds.xml")


#: Domains that trials take; those below are people's.
_DOMAINS = range(10, 100)
#: Who takes part in a domain listens on some of the 250 UDP ports from this one on, times 250.
_PORT, _PORTS = 7400, 250


class MiddlewareError(ContractError):
    """ROS cannot be started with these arguments, or in this environment."""


def unused_domain() -> int:
    """A ROS domain from 10 to 99 in which nobody on this computer takes part.

    For campaigns and benchmarks: whatever the shell says, they neither hear nor disturb a machine.

    Raises
    ------
    MiddlewareError
        All are in use.
    """
    ports = set[int]()
    for table in (Path("/proc/net/udp"), Path("/proc/net/udp6")):
        with suppress(OSError):  # no such protocol here
            rows = table.read_text(encoding="ascii").splitlines()[1:]
            ports |= {int(row.split()[1].rpartition(":")[2], 16) for row in rows}
    used = {(port - _PORT) // _PORTS for port in ports}
    first = os.getpid() % len(_DOMAINS)  # two that begin at once do not take the same one
    for domain in (*_DOMAINS[first:], *_DOMAINS[:first]):
        if domain not in used:
            return int(domain)
    raise MiddlewareError("all ROS domains from 10 to 99 are in use on this computer")


def start_ros(
    name: str,
    arguments: Sequence[str] = (),
    handlers: Any = None,
    *,
    rosout_alone: bool = False,
) -> None:
    """Start ROS in this process; `rclpy.try_shutdown` ends it.

    Parameters
    ----------
    name : str
        Of the executable.
    arguments : sequence of str
        Of its command line, `--ros-args ...` among them.
    handlers : rclpy.signals.SignalHandlerOptions, optional
        Which signals end ROS; by default all of which rclpy knows.
    rosout_alone : bool
        ROS's own loggers write to `/rosout` and nowhere else, as a write that waits would hold the
        whole process: of a node that writes its log by `hydro_msgs_docs.aside`.

    Raises
    ------
    MiddlewareError
        An argument, a file of parameters or a variable of the environment that ROS refuses.
    RobotError
        A file of parameters that cannot be read.
    """
    import rclpy
    from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError

    from hydro_model.robot_files import read_yaml

    # Checked here first, as rcl says less and in more lines.
    for flag, file in pairwise(arguments):
        if flag == "--params-file":
            read_yaml(Path(file))
    signals = {} if handlers is None else {"signal_handler_options": handlers}
    own = ("--ros-args", *ROSOUT_ALONE) if rosout_alone else ()
    try:
        prepare_middleware()
        rclpy.init(args=[name, *arguments, *own], **signals)
    except (RCLError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        line = " ".join(str(error).split())
        raise MiddlewareError(f"ROS cannot be started as it was asked to: {line}") from error


def prepare_middleware() -> None:
    """Set what the environment leaves open; before `rclpy.init`.

    Topics are kept on this computer: ROS itself would look for others in the whole subnet, and
    whoever is found may command valves. Publishers say every 0.1 s what they have sent, so that
    a subscriber asks again that soon for what it missed; Fast DDS itself would say it every 3 s,
    and until then a reliable topic stands still.
    """
    os.environ.setdefault(RANGE, LOCAL)
    os.environ.setdefault(PROFILES, str(PROFILES_FILE))
