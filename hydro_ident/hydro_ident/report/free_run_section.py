"""The free run: what the models do with what was recorded at the robot's boundary."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.report.figure import Axis, Figure, line, one_after_another
from hydro_ident.report.page import Row, Section, also, bullets, counted, number, paragraph, table
from hydro_ident.report.palette import BEFORE, INK, joint_colour
from hydro_ident.rollouts.free_run import FreeRun, JointRollout

_LEAD = (
    "Each model is started from the recorded state and then gets the recorded valve voltages with"
    " supply and tank pressure, or torques of joints without cylinder, and nothing else. Errors"
    " add up here: it is the hardest test of a model, and the one that a simulation has to pass."
)


def free_run_section(run: FreeRun | None, joints: Sequence[str]) -> Section:
    """Roll-outs from recorded inputs against the recording."""
    title = "Free run from the recorded inputs"
    if run is None:
        return Section("free_run", title, _LEAD, paragraph("None was made."))
    body = bullets(run.rejected, "no")
    if run.joints:
        body += paragraph(
            f"{counted(run.windows, 'window')} of {run.window_s:.2g} s that took no part in the"
            f" fit; {counted(run.whole_runs, 'whole run')}.",
            "",
        )
        head = ("joint", "unit", "error before", "error after", "whole run before", "after")
        body += table(head, [_row(j, joints) for j in run.joints])
        body += "".join(_figure(j, joints).html() for j in run.joints)
    return Section("free_run", title, _LEAD, body)


def _row(j: JointRollout, joints: Sequence[str]) -> Row:
    numbers = (j.rmse_before, j.rmse_after, j.whole_before, j.whole_after)
    cells = (j.joint, j.unit, *(number(v) for v in numbers))
    windows, whole = (also(pair, j.unit, " → ") for pair in (numbers[:2], numbers[2:]))
    below = "; ".join(filter(None, (windows, whole and f"whole run {whole}")))
    return Row(cells, below, joint_colour(joints, j.joint))


def _figure(j: JointRollout, joints: Sequence[str]) -> Figure:
    time_s, colour = one_after_another(j.time_s), joint_colour(joints, j.joint)
    position, error = Axis("position", j.unit), Axis("error", j.unit)
    traces = [line("measured", (time_s, position.of(j.measured)), INK, width=1.2)]
    sides = (("before", BEFORE, "dot", j.before), ("after", colour, "solid", j.after))
    for name, shade, dash, values in sides:
        if np.isfinite(values).all():
            traces.append(line(name, (time_s, position.of(values)), shade, dash=dash))
            off = (time_s, error.of(j.measured - values))
            traces.append(line(name, off, shade, panel=1, dash=dash, legend=False))
    return Figure(f"{j.joint}, free run", "time in s", (position, error), traces)
