"""Parameters with unit, value, interval, datasheet value and change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.bounds import effect_bounds
from hydro_ident.parameters import COMMAND_DELAY, Parameter
from hydro_ident.report.figure import Figure, unit_text
from hydro_ident.report.page import Row, folded, number, percent, table
from hydro_ident.report.palette import joint_colour
from hydro_model.robot import Robot

_HEAD = ("parameter", "value", "95 % interval", "unit", "datasheet", "change")
#: Intervals wider than this share of the value are not drawn: they would squeeze the others.
_DRAWN = 2.0
#: Parameters that no machine has below zero, beside those of the catalogue's effects.
_POSITIVE = ("mass", "viscous_friction", "bulk_modulus", "c_pa", "c_at", "c_bt", "c_pb")
#: Names before that of an effect's parameter: its owner's and its own.
_EFFECTS = 2
_WIDE = "hardly determined: its interval is wider than the value itself"


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
        """From the datasheet, as a share of it."""
        if not self.datasheet:
            return None
        return (self.value - self.datasheet) / abs(self.datasheet)


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
    joint = owner.get(p.name.split(".")[0], "")
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
    """A row, greyed where its interval holds the least value that is possible.

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
    why = (
        f"not told from its bound {number(least)}{unit}, which its interval reaches; the value"
        " found is in the model"
    )
    return replace(row, below=f"{row.below}; {why}" if row.below else why, off=True)


def _least(name: str) -> float:
    """The least value that a parameter can have; minus infinity where none is known."""
    *owner, last = name.split(".")
    if last in _POSITIVE or name == COMMAND_DELAY:
        return 0.0
    return effect_bounds(name).lower if len(owner) == _EFFECTS else -np.inf


def parameter_table(rows: Sequence[ParameterRow], joints: Sequence[str]) -> str:
    """The table, what is not determined greyed."""
    cells = []
    for p in rows:
        interval = "–"
        if p.interval is not None:
            interval = " … ".join(number(bound, 5) for bound in p.interval)
        given = number(p.datasheet, 5)
        change = "–" if p.off or p.change is None else _change(p.change)
        texts = (p.name, number(p.value, 5), interval, unit_text(p.unit), given, change)
        dot = joint_colour(joints, p.joint) if p.joint else ""
        cells.append(Row(texts, p.below, dot, p.off))
    return table(_HEAD, cells, stacked=True) if cells else ""


def _change(change: float) -> str:
    return percent(change, 0 if abs(change) >= 1.0 else 1, "+")


def change_figure(rows: Sequence[ParameterRow], joints: Sequence[str]) -> str:
    """Changes from the datasheet with their intervals; empty where there are none."""
    shown = [p for p in rows if not p.off and p.interval is not None and _span(p) < _DRAWN]
    if not shown:
        return ""
    traces = []
    for joint in dict.fromkeys(p.joint for p in shown):
        own = [p for p in shown if p.joint == joint]
        change = np.array([100.0 * (p.change or 0.0) for p in own])
        ends = np.array([p.interval or (p.value, p.value) for p in own])
        given = np.array([p.datasheet or 1.0 for p in own])
        low, high = (100.0 * (ends[:, k] - given) / np.abs(given) for k in (0, 1))
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
                "marker": {"color": colour, "size": 8},
            }
        )
    layout = {"xaxis": {"zeroline": True}}
    title = "Change from the datasheet, with 95 % intervals"
    # From what is in the figure's title: below names there is little room on a narrow screen.
    figure = Figure(title, "change in %", ("parameter (name)",), traces, layout, rows=len(shown))
    return folded("Changes as a figure", figure.html()) if len(shown) > 1 else ""


def _span(p: ParameterRow) -> float:
    if not p.datasheet or p.interval is None:
        return np.inf
    return (p.interval[1] - p.interval[0]) / abs(p.datasheet)
