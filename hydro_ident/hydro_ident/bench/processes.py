"""Installed executables as processes of a benchmark, in a ROS domain of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from hydro_ident.errors import IdentError
from hydro_ident.study.patience import run_within
from hydro_msgs_docs.middleware import DOMAIN, unused_domain

LIFECYCLE = "hydro_control.node.lifecycle_command"
#: How long to wait for an end.
_END_S = 10.0
#: What `lifecycle` itself waits for a node's transition and for a trip to be cleared, and how much
#: more its own start and end may take.
_NODE_S, _TRIP_S, _BESIDE_S = 120.0, 10.0, 60.0


class Processes:
    """Processes with a log each.

    Parameters
    ----------
    folder : Path
        Gets the logs.

    Attributes
    ----------
    folder : Path
    by_name : dict from name to process
    environment : dict of str to str
        Theirs.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.by_name: dict[str, subprocess.Popen[bytes]] = {}
        self.environment = {
            **os.environ,
            DOMAIN: str(unused_domain()),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }

    def start(self, name: str, words: Sequence[str]) -> None:
        """Start the interpreter with some words, under a name."""
        with (self.folder / f"{name}.log").open("wb") as log:
            self.by_name[name] = subprocess.Popen(
                [sys.executable, *words], stdout=log, stderr=log, env=self.environment
            )

    def transition(self, what: str, node: str) -> None:
        """Ask a lifecycle node for a transition; IdentError where it refuses or does not answer.

        `what` is its name, as `lifecycle` takes it.
        """
        done = self._asked(what, f"/{node}", _NODE_S)
        if done.returncode:
            raise IdentError(f"chain: {done.stderr.decode(errors='replace').strip()}")

    def clear_trip(self) -> bool:
        """Clear the bridge's trip; whether there was one that could be cleared."""
        return b"cleared:" in self._asked("clear_trip", "/can_bridge", _TRIP_S).stdout

    def _asked(self, what: str, node: str, wait_s: float) -> subprocess.CompletedProcess[bytes]:
        words = [sys.executable, *entry(LIFECYCLE), what, node, "--timeout", f"{wait_s:g}"]
        how = {"env": self.environment, "capture_output": True, "check": False}
        return run_within(wait_s + _BESIDE_S, f"lifecycle {what} {node}", words, **how)

    def stop(self) -> None:
        """End all of them, the last one started first."""
        for one in reversed(self.by_name.values()):
            one.terminate()
        for one in self.by_name.values():
            try:
                one.wait(_END_S)
            except subprocess.TimeoutExpired:
                one.kill()
                one.wait()

    def last_words(self) -> str:
        """The last line of every log."""
        lines = [
            f"{path.stem}: {text.splitlines()[-1]}"
            for path in sorted(self.folder.glob("*.log"))
            if (text := path.read_text(encoding="utf-8", errors="replace").strip())
        ]
        return "; ".join(lines)


def entry(module: str) -> list[str]:
    """Words for the interpreter that run a module's `main` as the installed executables do.

    `module` is that of the entry point.
    """
    return ["-c", f"import sys; from {module} import main; sys.exit(main())"]


def cpu_s(pid: int) -> float:
    """Time on the processors that a process has had so far, s.

    `pid` is that of the process, which runs.
    """
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
