"""Parameters with unit, value, interval, what they are compared with and change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.forces.bounds import effect_bounds
from hydro_ident.everyday_units import everyday, rounded
from hydro_ident.parameters.parameter_names import parts_of
from hydro_ident.parameters.parameters import COMMAND_DELAY, Parameter
from hydro_ident.report.figure import Figure, unit_text
from hydro_ident.report.page import Row, also, folded, number, paragraph, percent, table
from hydro_ident.report.palette import joint_colour, joint_symbol
from hydro_model.robot import Robot

#: The heading of what is compared with stands between these.
_HEAD, _LAST = ("parameter", "value", "95 % interval", "unit"), "change"
DATASHEET, EARLIER = "datasheet", "earlier model"
#: What names of parameters end with, and what that means.
_SIGNS = (
    (
        ("mcx", "mcy", "mcz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
        "mcx, mcy, mcz: first moments, the mass times the coordinates of its centre (m·c), in the"
        " joint's frame; ixx … izz: inertias about that frame's origin (of barrels and rods: along"
        " their line, about their pin).",
    ),
    (
        ("c_pa", "c_at", "c_pb", "c_bt"),
        "c_pa, c_at, c_pb, c_bt: gains of a valve's edges, supply to A, A to tank, supply to B and"
        " B to tank; in l/min: the flow at full opening and a pressure drop of 35 bar over the"
        " edge.",
    ),
)
#: Digits of what is known best.
_DIGITS = 5
#: Intervals wider than this share of the value are not drawn: they would squeeze the others.
_DRAWN = 2.0
#: Parameters that no machine has below zero, beside those of the catalogue's effects.
_POSITIVE = ("mass", "viscous_friction", "bulk_modulus", "c_pa", "c_at", "c_bt", "c_pb")
_FOUND = "the value found is in the model"
_WIDE = f"hardly determined: its interval is wider than the value itself; {_FOUND}"


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """A parameter as a report lists it.

    Attributes
    ----------
    name : str
    value : float
    interval : pair of float or None
    unit : str
    datasheet : float or None
        The given robot's value, where it has one: a datasheet's, or an earlier model's.
    below : str
        What it stands for, or why it is greyed.
    off : bool
        Not determined, or not used.
    joint : str
        Empty where it is of no single one.
    """

    name: str
    value: float
    interval: tuple[float, float] | None
    unit: str
    datasheet: float | None
    below: str
    off: bool
    joint: str

    @property
    def change(self) -> float | None:
        """From `datasheet`, as a share of it."""
        if not self.datasheet:
            return None
        return (self.value - self.datasheet) / abs(self.datasheet)


def compared_with(robot: Robot) -> str:
    """What a robot's own numbers are: the datasheet's, or an earlier model's.

    Parameters
    ----------
    robot : Robot
        As given. A model file brings base parameters or deviations with it.
    """
    return EARLIER if robot.base_parameters or robot.standard_deviations else DATASHEET


def signs(rows: Sequence[ParameterRow]) -> str:
    """What the short names of parameters stand for, as far as they are there."""
    last = {p.name.rsplit(".", 1)[-1] for p in rows}
    text = " ".join(text for names, text in _SIGNS if last.intersection(names))
    return paragraph(text, "signs") if text else ""


def owners(robot: Robot) -> Mapping[str, str]:
    """Joint of every name that a parameter's name may begin with."""
    found = {j.child_link: j.name for j in robot.joints} | {j.name: j.name for j in robot.joints}
    found |= {c.name: c.joint for c in robot.cylinders}
    parts = ("barrel", "rod")
    found |= {f"{c.name}_{part}": c.joint for c in robot.cylinders for part in parts}
    return found | {v.name: robot.cylinder(v.cylinder).joint for v in robot.valves}


def readable(parameter: Parameter) -> str:
    """A base parameter as the sum it stands for, any other by its name."""
    text = parameter.name
    for name, factor in parameter.combination.items():
        if name != parameter.name:
            size = "" if abs(factor) == 1.0 else f"{abs(factor):.6g} "
            text += f" {'-' if factor < 0.0 else '+'} {size}{name}"
    return text


def identified_row(p: Parameter, owner: Mapping[str, str]) -> ParameterRow:
    """A row of an identified parameter.

    `p` is the parameter.
    """
    # Why a stage was rejected is long, and stands above the table once.
    stage, rejected, _ = p.reason.partition(" rejected: ")
    why = f"{stage} rejected, for the reason above the table" if rejected else p.reason
    if not why and not p.identifiable:
        why = "these recordings do not determine it: the given value stays in the model"
    stands = readable(p)
    words = [f"stands for {stands}"] if stands != p.name else []
    words += [why] if why else []
    joint = owner.get(parts_of(p.name)[0], "")
    off = p.held or not p.identifiable
    text = "; ".join(words)
    row = ParameterRow(p.name, p.value, p.ci95, p.unit, p.datasheet, text, off, joint)
    return _determined(beside_bound(row, p.name))


def _determined(row: ParameterRow) -> ParameterRow:
    """Greyed where the interval says that the value could as well be nothing or the double."""
    if row.off or row.interval is None:
        return row
    if row.interval[1] - row.interval[0] <= 2.0 * max(abs(row.value), abs(row.datasheet or 0.0)):
        return row
    return replace(row, below=f"{row.below}; {_WIDE}" if row.below else _WIDE, off=True)


def beside_bound(row: ParameterRow, name: str) -> ParameterRow:
    """A row of the model, greyed where its interval holds the least value that is possible.

    Parameters
    ----------
    row : ParameterRow
    name : str
        Of the parameter, as the result file has it.
    """
    least = _least(name)
    if row.off or row.interval is None or least < 0.0 or row.interval[0] > least:
        return row
    unit = "" if row.unit in ("", "1") else f" {row.unit}"
    why = f"not told from its bound {number(least)}{unit}, which its interval reaches; {_FOUND}"
    return replace(row, below=f"{row.below}; {why}" if row.below else why, off=True)


def _least(name: str) -> float:
    """The least value that a parameter can have; minus infinity where none is known."""
    _, effect, last = parts_of(name)
    if last in _POSITIVE or name == COMMAND_DELAY:
        return 0.0
    return effect_bounds(name).lower if effect else -np.inf


def parameter_table(
    rows: Sequence[ParameterRow], joints: Sequence[str], given: str = DATASHEET
) -> str:
    """The table, what is not determined greyed.

    Parameters
    ----------
    rows : sequence of ParameterRow
    joints : sequence of str
        Of the robot, for the colours.
    given : str
        What the values that are compared with are of.

    Returns
    -------
    str
        Empty without rows.
    """
    cells = []
    for p in rows:
        interval = "–"
        if p.interval is not None:
            interval = " … ".join(as_known(bound, p.interval) for bound in p.interval)
        change = "–" if p.off or p.change is None else _change(p.change)
        unit, old = unit_text(p.unit), number(p.datasheet, 5)
        texts = (p.name, as_known(p.value, p.interval), interval, unit, old, change)
        dot = joint_colour(joints, p.joint) if p.joint else ""
        below = "; ".join(filter(None, (_as_people_tell(p, given), p.below)))
        cells.append(Row(texts, below, dot, p.off))
    return table((*_HEAD, given, _LAST), cells, stacked=True) if cells else ""


def as_known(value: float, interval: tuple[float, float] | None) -> str:
    """A number with as many digits as its interval leaves it: two of the half width.

    Parameters
    ----------
    value : float
    interval : pair of float or None
        Of 95 %; of what has none five digits are told.

    Returns
    -------
    str
        At least two digits, at most five.
    """
    half = 0.0 if interval is None else 0.5 * (interval[1] - interval[0])
    if not (0.0 < half < np.inf) or value == 0.0:
        return number(value, _DIGITS)
    wanted = 2 + int(np.floor(np.log10(abs(value))) - np.floor(np.log10(half)))
    return number(value, min(max(wanted, 2), _DIGITS))


def _as_people_tell(p: ParameterRow, given: str) -> str:
    """Value and what it is compared with, in another unit where people use one."""
    unit = everyday(p.unit)
    value = p.value if p.interval is None else float(as_known(p.value, p.interval))
    told = also((value,), p.unit)
    if unit is None or not p.datasheet:
        return told
    return f"{told} ({given} {rounded(unit[1] * p.datasheet)})"


def _change(change: float) -> str:
    return percent(change, 0 if abs(change) >= 1.0 else 1, "+")


def change_figure(
    rows: Sequence[ParameterRow], joints: Sequence[str], given: str = DATASHEET
) -> str:
    """Changes with their intervals.

    Parameters
    ----------
    rows : sequence of ParameterRow
    joints : sequence of str
        Of the robot, for the colours.
    given : str
        What the changes are from.

    Returns
    -------
    str
        Empty where there are none.
    """
    shown = [p for p in rows if not p.off and p.interval is not None and _span(p) < _DRAWN]
    if not shown:
        return ""
    traces = []
    for joint in dict.fromkeys(p.joint for p in shown):
        own = [p for p in shown if p.joint == joint]
        change = np.array([100.0 * (p.change or 0.0) for p in own])
        ends = np.array([p.interval or (p.value, p.value) for p in own])
        old = np.array([p.datasheet or 1.0 for p in own])
        low, high = (100.0 * (ends[:, k] - old) / np.abs(old) for k in (0, 1))
        colour = joint_colour(joints, joint)
        error = {
            "type": "data",
            "symmetric": False,
            "array": [round(float(v), 3) for v in high - change],
            "arrayminus": [round(float(v), 3) for v in change - low],
            "color": colour,
        }
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": joint or "machine",
                "x": [round(float(v), 3) for v in change],
                "y": [p.name for p in own],
                "yaxis": "y",
                "error_x": error,
                "marker": {
                    "color": colour,
                    "symbol": joint_symbol(joints, joint),
                    "size": 8,
                },
            }
        )
    layout = {"xaxis": {"zeroline": True}}
    title = f"Change from the {given}, with 95 % intervals"
    # From what is in the figure's title: below names there is little room on a narrow screen.
    figure = Figure(title, "change in %", ("parameter (name)",), traces, layout, rows=len(shown))
    return folded("Changes as a figure", figure.html()) if len(shown) > 1 else ""


def _span(p: ParameterRow) -> float:
    if not p.datasheet or p.interval is None:
        return np.inf
    return (p.interval[1] - p.interval[0]) / abs(p.datasheet)
