"""A timer alone in a process, every 2 ms: how late the operating system wakes whoever waits.

    python -m hydro_hw_bridge.faults.bare_timer FILE

Writes pairs of little-endian 64-bit integers: the monotonic time of a deadline and its lateness,
ns. What is late here is not late because of anything of ours.
"""

from __future__ import annotations

import struct
import sys
import time
from pathlib import Path

from hydro_msgs_docs.endings import on_end

PERIOD_NS = 2_000_000
RECORD = struct.Struct("<qq")


def main() -> int:
    """Entry point."""
    stopping: list[bool] = []
    on_end(lambda: stopping.append(True))
    with Path(sys.argv[1]).open("wb", buffering=0) as stream:
        deadline = time.monotonic_ns()
        while not stopping:
            deadline += PERIOD_NS
            time.sleep(max(0, deadline - time.monotonic_ns()) / 1e9)
            late = time.monotonic_ns() - deadline
            stream.write(RECORD.pack(deadline, late))
            # Deadlines that passed meanwhile were one stall, not many.
            deadline += late - late % PERIOD_NS
    return 0


if __name__ == "__main__":
    sys.exit(main())
