"""Words that the verdicts of both reports share."""

from __future__ import annotations

from collections.abc import Sequence

from hydro_ident.identify.recording_summary import RecordingSummary
from hydro_ident.identify.verdict import BagLoss
from hydro_ident.report.channel_rows import ChannelRows
from hydro_ident.report.correlation import FEWEST_ROWS
from hydro_ident.report.figure import unit_text
from hydro_ident.report.page import also, number, percent
from hydro_ident.rollouts.free_run import FreeRun

#: A residual within so many times the sensors' noise is as good as explained.
NEAR_NOISE = 2.0
#: Lines of a card before the rest is counted.
_LINES = 4

#: What to do with a model that can be driven.
DRIVE = (
    "Drive a path with model.yaml, which stands beside this report, and the gains that this"
    " machine was driven with (those in controller.yaml are the package's), slowly first, and"
    " compare its control table with the old one."
)


def plain(name: str) -> str:
    """An identifier in words."""
    words = name.replace("_", " ").replace(".", ": ")
    for proper in ("coulomb", "stribeck"):
        words = words.replace(proper, proper.capitalize())
    return words


def few_rows(one: ChannelRows) -> str:
    """What is put behind a channel's figures that rest on few rows; empty where they are enough.

    Parameters
    ----------
    one : ChannelRows
    """
    if not 0 < one.count < FEWEST_ROWS:
        return ""
    plural = "" if one.count == 1 else "s"
    return f", of {one.count} row{plural} ({number(one.seconds, 2)} s) alone"


def error_line(channels: Sequence[ChannelRows]) -> list[str]:
    """How much better the model's channels are predicted: most and least."""
    known = [c for c in channels if c.value("rmse_before") > 0.0 and not c.rejected]
    if not known:
        return []
    known.sort(key=lambda c: c.value("rmse_after") / c.value("rmse_before"))
    best, least = known[0], known[-1]
    a, b, n = (number(best.value(k), 3) for k in ("rmse_before", "rmse_after", "noise_floor"))
    share = least.value("rmse_after") / least.value("rmse_before")
    told = also([best.value(k) for k in ("rmse_before", "rmse_after")], best.unit, " to ")
    told = f"{told}; " if told else ""
    line = (
        f"On rows that took no part, the error changes most in {best.name}: from {a} to {b}"
        f" {unit_text(best.unit)} ({told}sensor noise alone: {n}){few_rows(best)}"
    )
    if len(known) == 1:
        return [f"{line}."]
    told = "where it is unchanged" if percent(share) == percent(1.0) else f"to {percent(share)}"
    return [f"{line}; least in {least.name}{few_rows(least)}, {told}."]


def most_left(channels: Sequence[ChannelRows]) -> tuple[str, float]:
    """The channel that is furthest above its sensors' noise, and how many times; nothing, 0.

    Beside its name stands where this is of few rows.
    """
    ratios = [
        (c.name + few_rows(c), c.value("rmse_after") / noise)
        for c in channels
        if (noise := c.value("noise_floor")) > 0.0
    ]
    return max(ratios, key=lambda one: one[1], default=("", 0.0))


def noise_line(channels: Sequence[ChannelRows]) -> list[str]:
    """How far above the sensors' noise the residuals are."""
    name, ratio = most_left(channels)
    if not name:
        return []
    if ratio <= NEAR_NOISE:
        return [f"What is left is sensor noise: at most {ratio:.1f} times it, in {name}."]
    return [f"What is left is up to {ratio:.0f} times sensor noise, most in {name}."]


def free_run_line(run: FreeRun | None) -> list[str]:
    """What the free run says, joint by joint."""
    if run is None or not run.joints:
        return []
    parts = []
    for j in run.joints:
        if j.rmse_before is None or j.rmse_after is None:
            continue
        told = also((j.rmse_before, j.rmse_after), j.unit, " → ")
        sizes = f"{number(j.rmse_before, 2)} → {number(j.rmse_after, 2)} {j.unit}"
        parts.append(f"{j.joint} {sizes}{f' ({told})' if told else ''}")
    if not parts:
        return []
    errors = ", ".join(parts)
    return [f"Simulated for {run.window_s:.2g} s from the recorded inputs alone, error: {errors}."]


def loss_line(losses: Sequence[BagLoss]) -> list[str]:
    """How many channels the bags do not give."""
    if not losses:
        return []
    names = ", ".join(dict.fromkeys(loss.channel for loss in losses))
    return [f"Not in every recording: {names} (data health says what was done without)."]


def health_line(recordings: Sequence[RecordingSummary]) -> list[str]:
    """Whether something is wrong with the recordings themselves."""
    found = [f for r in recordings for f in r.findings if not f.harmless]
    wrong = [f"{f.signal} {f.kind.replace('_', ' ')}" for f in found]
    if not wrong:
        return []
    return [f"The recordings are not clean ({shortened(wrong)}): see data health first."]


def shortened(words: Sequence[str], most: int = _LINES) -> str:
    """The first few of a list, and how many more there are.

    `words` is that list.
    """
    unique = list(dict.fromkeys(words))
    more = len(unique) - most
    return ", ".join(unique[:most]) + (f" and {more} more" if more > 0 else "")


def limited(lines: Sequence[str], most: int = _LINES + 2) -> tuple[str, ...]:
    """The first lines of a card, and how many more there are."""
    more = len(lines) - most
    return (*lines[:most], *([f"… and {more} more below."] if more > 0 else []))
