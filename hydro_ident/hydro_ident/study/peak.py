"""Commands as processes of their own, with the time they take and the memory they need."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hydro_ident.errors import IdentError
from hydro_ident.study.patience import unended

_POLL_S = 0.1
#: What a run may take, s: the longest, of a bag of hours, takes some minutes.
PATIENCE_S = 7200.0


@dataclass(frozen=True, slots=True)
class Spent:
    """What a process took.

    Attributes
    ----------
    seconds : float
        From before its start until it was seen to have ended.
    peak_mb : float
        Largest resident memory, MiB; of what it forked only what is not shared with it.
    begun_s : float
        `time.monotonic` at its start, the same clock in every process.
    """

    seconds: float
    peak_mb: float
    begun_s: float


def spent(module: str, arguments: Sequence[str], patience_s: float = PATIENCE_S) -> Spent:
    """Run a module of ours as a process and watch it.

    Parameters
    ----------
    module : str
        As for `python -m`.
    arguments : sequence of str
    patience_s : float
        How long it may take.

    Returns
    -------
    Spent

    Raises
    ------
    IdentError
        It failed, or did not end in time.
    """
    with tempfile.TemporaryFile() as said:
        began = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments], stdout=subprocess.DEVNULL, stderr=said
        )
        peak_kb = 0
        while process.poll() is None:
            if time.monotonic() - began > patience_s:
                process.kill()
                process.wait()
                raise unended(module, patience_s)
            largest, now = (status_kb(process.pid, key) for key in ("VmHWM", "VmRSS"))
            peak_kb = max(peak_kb, largest, now + _forked_kb(process.pid))
            time.sleep(_POLL_S)
        seconds = time.monotonic() - began
        if process.returncode:
            said.seek(0)
            text = said.read().decode(errors="replace").strip()
            raise IdentError(f"{module} ended with {process.returncode}: {text}")
    return Spent(seconds, peak_kb / 1024.0, began)


def status_kb(pid: int, key: str) -> int:
    """A size that the kernel states of a process; 0 once it has ended.

    The usage that `wait` reports would begin with the memory of the process that forked it.

    Parameters
    ----------
    pid : int
        Of the process.
    key : {"VmHWM", "VmRSS"}
        Largest resident memory so far, and the present one.
    """
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith(f"{key}:")), 0)


def _forked_kb(pid: int) -> int:
    """Memory that the children of a process share with nobody; 0 of those that have ended."""
    total = 0
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
        for child in children:
            lines = Path(f"/proc/{child}/smaps_rollup").read_text(encoding="ascii").splitlines()
            total += sum(int(line.split()[1]) for line in lines if line.startswith("Private_"))
    except OSError:
        return total
    return total
