"""What the recordings are worth: data health, excitation, and how well the tip was controlled."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hydro_ident.everyday_units import everyday, rounded
from hydro_ident.identify.recording_summary import JointMotion, RecordingSummary
from hydro_ident.identify.verdict import BagLoss
from hydro_ident.inspecting.inspection import Range
from hydro_ident.report.figure import Axis, Figure, path, unit_text
from hydro_ident.report.page import (
    Row,
    Section,
    also,
    bullets,
    folded,
    number,
    paragraph,
    percent,
    table,
    written,
)
from hydro_ident.report.palette import joint_colour
from hydro_ident.report.verdict_words import plain

_NONE = "No recording has a cycle of the robot."


def health_section(
    recordings: Sequence[RecordingSummary], losses: Sequence[BagLoss], joints: Sequence[str]
) -> Section:
    """Rates, gaps, irregular signals and ranges."""
    title = "Data health"
    lead = "Whether the recordings can be trusted: nothing of what is listed here was repaired."
    if not recordings:
        return Section("health", title, lead, paragraph(_NONE) + _lost(losses))
    rows: list[tuple[str, ...]] = [
        (r.name, _role(r), f"{r.duration_s:.1f}", f"{r.rate_hz:.4g}", str(r.gaps), str(r.missing),
         "–" if r.longest_gap is None else r.longest_gap.text)
        for r in recordings
    ]  # fmt: skip
    head = ("recording", "used to", "length s", "rate Hz", "gaps", "cycles missing", "longest gap")
    body = table(head, rows, text=(1,)) + _irregular(recordings) + _lost(losses)
    body += bullets([f"{r.name}: {note}" for r in recordings for note in r.notes])
    for r in recordings:
        body += folded(f"Ranges of {r.name}", _ranges(r.ranges, joints))
    return Section("health", title, lead, body)


def _irregular(recordings: Sequence[RecordingSummary]) -> str:
    """What is wrong with signals, then what is worth knowing and harmless."""
    rows = [
        (one.harmless, (r.name, one.signal, one.kind.replace("_", " "), one.text))
        for r in recordings
        for one in r.findings
    ]
    wrong, known = ([row for harmless, row in rows if harmless == side] for side in (False, True))
    head = ("recording", "signal", "what", "in numbers")
    body = (
        "<h3>Irregular signals</h3>" + table(head, wrong, text=(0, 1, 2, 3))
        if wrong
        else paragraph("No signal is stuck, saturated, out of range or latched.", "")
    )
    said = [f"{name}: {signal}: {text}" for name, signal, _, text in known]
    if said:
        body += paragraph("Worth knowing, too little to matter:", "") + bullets(said)
    return body


def _lost(losses: Sequence[BagLoss]) -> str:
    if not losses:
        return ""
    rows = [(loss.bag, loss.channel, loss.reason) for loss in losses]
    head = ("recording", "channel", "reason")
    return "<h3>Channels lost</h3>" + table(head, rows, text=(1, 2))


def _role(recording: RecordingSummary) -> str:
    return "fit" if recording.training else "check"


def _ranges(ranges: Sequence[Range], joints: Sequence[str]) -> str:
    rows = []
    for one in ranges:
        joint = one.signal.split()[0]
        dot = joint_colour(joints, joint) if joint in joints else ""
        cells = (
            one.signal,
            unit_text(one.unit),
            *(number(v) for v in (one.low, one.high, one.mean)),
        )
        rows.append(Row(cells, _as_people_tell(one), dot))
    return table(("signal", "unit", "lowest", "highest", "mean"), rows)


def _as_people_tell(one: Range) -> str:
    told = everyday(one.unit)
    if told is None:
        return ""
    low, high, mean = (rounded(told[1] * value) for value in (one.low, one.high, one.mean))
    return f"{low} … {high}, mean {mean} {told[0]}"


def excitation_section(
    recordings: Sequence[RecordingSummary],
    joints: Sequence[str],
    not_testable: Sequence[tuple[str, str]],
) -> Section:
    """How far and how fast the joints moved, and what could not have shown.

    Parameters
    ----------
    recordings : sequence of RecordingSummary
    joints : sequence of str
    not_testable : sequence of pair of str
        Effects that these recordings could not have shown, and why.
    """
    title = "Excitation"
    lead = (
        "What a recording never did, no fit can tell: a good one visits most of each joint's"
        " range, slowly and fast, and turns round often."
    )
    rows = [
        Row(_motion_cells(r, m), _in_degrees(m), joint_colour(joints, m.joint))
        for r in recordings
        for m in r.motion
    ]
    if not rows:
        return Section("excitation", title, lead, paragraph("No joint position was recorded."))
    head = ("joint", "recording", "from", "to", "share of range", "speed", "of limit", "moving",
            "reversals")  # fmt: skip
    body = table(head, rows, text=(1,))
    body += paragraph(
        "Positions in rad (m), speed not passed 99 % of the time in rad/s (m/s).", "none"
    )
    body += '<div class="pair">' + "".join(_covered(recordings, joints)) + "</div>"
    if not_testable:
        body += "<h3>What these recordings could not have shown</h3>"
        named = [(plain(name), written(why)) for name, why in not_testable]
        body += table(("effect", "why"), named, text=(1,))
    return Section("excitation", title, lead, body)


def _motion_cells(r: RecordingSummary, m: JointMotion) -> tuple[str, ...]:
    limits = m.upper - m.lower
    travel = percent((m.high - m.low) / limits) if 0.0 < limits < math.inf else "–"
    speed = percent(m.speed / m.speed_limit) if m.speed_limit > 0.0 else "–"
    return (
        m.joint, r.name, number(m.low, 3), number(m.high, 3), travel,
        number(m.speed, 3), speed, percent(m.moving_share), str(m.reversals),
    )  # fmt: skip


def _in_degrees(m: JointMotion) -> str:
    told = also((m.low, m.high), m.unit), also((m.speed,), f"{m.unit}/s")
    return ", ".join(filter(None, told))


def _covered(recordings: Sequence[RecordingSummary], joints: Sequence[str]) -> list[str]:
    """Where in position and speed each joint has been, recording by recording."""
    figures = []
    for k, joint in enumerate(joints):
        colour = joint_colour(joints, joint)
        units = [m.unit for r in recordings for m in r.motion if m.joint == joint]
        if not units:
            continue
        x, y = Axis("position", units[0]), Axis("speed", f"{units[0]}/s")
        traces = []
        for r in recordings:
            way = x.of(r.position[:, k]), y.of(r.velocity[:, k])
            dash = "solid" if r.training else "dot"
            traces.append(path(f"{_role(r)}: {r.name}", way, colour, dash=dash))
        figures.append(Figure(f"{joint}: positions and speeds visited", x, (y,), traces).html())
    return figures


def control_section(recordings: Sequence[RecordingSummary]) -> Section:
    """How well the tip followed its reference in each recording that has one."""
    title = "Control"
    lead = (
        "How well the tip followed its reference in these recordings, by the encoders. Rho is the"
        " largest error over the largest speed. What a new model is worth shows in a new recording"
        " of the same path: the table of its report stands beside this one."
    )
    rows, thin = [], False
    for r in recordings:
        t = r.tracking
        if t is not None:
            thin |= r.thinned > 1
            rows.append(
                (r.name, f"{t.duration_s:.1f}", number(t.rmse_mm), number(t.max_error_mm),
                 number(t.max_speed_m_s), number(t.rho_s))
            )  # fmt: skip
    if not rows:
        text = (
            "No recording holds a tip reference that moves: record a path driven by the controller"
            " to see its errors here, or run `tracking` on such a bag."
        )
        return Section("control", title, lead, paragraph(text))
    head = ("recording", "path s", "RMSE mm", "max error mm", "max speed m/s", "rho s")
    body = table(head, rows)
    if thin:
        body += paragraph("Long recordings are judged on thinned cycles.", "none")
    return Section("control", title, lead, body)
