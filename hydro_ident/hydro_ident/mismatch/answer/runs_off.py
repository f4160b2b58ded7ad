"""Roll-outs that the findings put further off: what fits rows need be no law to simulate."""

from __future__ import annotations

from collections.abc import Iterator

from hydro_ident.rollouts.free_run import FreeRun

#: Error of a roll-out with the findings over that without from which they are in doubt.
_TIMES = 2.0
#: The same in rad or m below which nobody sees it.
_LEAST = 5.0e-4


def runs_off(run: FreeRun) -> list[str]:
    """Notes on joints that the model with the findings rolls out clearly worse than without.

    Parameters
    ----------
    run : FreeRun
        Of both, along the recordings to verify on.

    Returns
    -------
    list of str
    """
    return [
        f"{joint}: {over} the model with the findings is {after:.3g} {unit} off (rms), without"
        f" them {before:.3g}: one of them is no law to simulate with, though rows agree with it;"
        " --refine fits them by roll-outs"
        for joint, unit, over, before, after in _pairs(run)
        if after > max(_TIMES * before, _LEAST)
    ]


def _pairs(run: FreeRun) -> Iterator[tuple[str, str, str, float, float]]:
    """Errors before and after of every joint, over windows and whole runs."""
    for one in run.joints:
        for over, before, after in (
            ("over windows", one.rmse_before, one.rmse_after),
            ("over whole runs", one.whole_before, one.whole_after),
        ):
            if before is not None and after is not None:
                yield one.joint, one.unit, over, before, after
