"""Names of the jobs that there are: rows of others are of code that is gone."""

from __future__ import annotations

import re
from collections.abc import Iterable

from hydro_ident.bench import chain_jobs, growth, limits
from hydro_ident.bench.fit_jobs import SAMPLES
from hydro_ident.errors import IdentError

_NUMBER = r"[\d.]+"
_GROWING = "|".join((*growth.READERS, *growth.LIVE, growth.HELD))
_QUANTILES = "|".join(map(re.escape, chain_jobs.QUANTILES))
_PATTERNS = (
    rf"(torque regressor|inverse dynamics), {_NUMBER} samples, [26] joints",
    rf"simulation, two joints, {_NUMBER} s(, base model|, every effect on)?",
    rf"base-parameter fit, {SAMPLES} samples, 6 joints, friction, intervals"
    r"( for (white|autocorrelated) noise|: peak memory of the process, MiB)",
    r"bag to columns, a minute at 500 Hz, zstd",
    rf"diagnose, {_NUMBER}-minute bag: (located and named|in all|peak memory of the process, MiB)",
    "|".join(map(re.escape, (limits.BASE, limits.LISTED))),
    rf"bridge and controller, sensor frame to valve frame({chain_jobs.REACTION})?,"
    rf" ({_QUANTILES})",
    r"(bridge|controller) at 500 Hz: share of a core",
    "|".join(map(re.escape, (limits.EMPTY, limits.HELP, limits.INSPECTED))),
    rf"({_GROWING}), a bag of {_NUMBER} to {_NUMBER} minutes:"
    rf" exponent of ({growth.WALL}|{growth.CPU}|peak memory)",
    rf"recorder, bags of {_NUMBER} to {_NUMBER} minutes: {growth.LOST}",
)


def refuse_unknown(jobs: Iterable[str], where: str) -> None:
    """Refuse rows of jobs that there are not.

    Every row is asked for when it is measured, too: so no job can be forgotten here.

    Parameters
    ----------
    jobs : iterable of str
        Names.
    where : str
        They were found, for the error.

    Raises
    ------
    IdentError
        There is one.
    """
    gone = [job for job in jobs if not any(re.fullmatch(one, job) for one in _PATTERNS)]
    if gone:
        raise IdentError(f"{where}: expected jobs of the benchmark, found {'; '.join(gone)}")
