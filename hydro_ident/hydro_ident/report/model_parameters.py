"""Parameters of a diagnosis as rows of a report: those of findings, and of the model's own."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.answer.diagnosis_file import finding_dict, law_of_model
from hydro_ident.mismatch.answer.outcome import Diagnosis, Finding
from hydro_ident.parameters.parameters import COMMAND_DELAY, NORMAL_95, Parameter
from hydro_ident.report.found_words import as_share, corners, law_in_model
from hydro_ident.report.parameter_section import ParameterRow, beside_bound, identified_row
from hydro_ident.report.verdict_words import plain
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import STANDARD_PARAMETERS, STANDARD_UNITS, Robot

_EDGES = ("c_pa", "c_at", "c_bt", "c_pb")
_HELD = "not fitted: as given"
_AT_BOUND = "held at the end of what is possible, or by what was found: not estimated"
_UNKNOWN = "these recordings do not determine it: the given value stays"
_UNTOLD = "these recordings do not determine it: the value shown came with the others'"
#: A value is the given one to this share: sums of the file's numbers round.
_SAME = 1e-9


def finding_rows(found: Diagnosis, one: Finding, owner: Mapping[str, str]) -> list[ParameterRow]:
    """The parameters of one finding: those of the law that model.yaml has for it."""
    data = finding_dict(found, one)
    law = law_in_model(data)
    if law:
        data = {**data, **law_of_model(found, one)}
    joint = owner.get(data["target"].split("/")[0], "")
    rows = []
    slow = corners(data)
    for p in [*data["parameters"], *slow]:
        std = p["std"]
        interval = None
        if std is not None:
            interval = p["value"] - NORMAL_95 * std, p["value"] + NORMAL_95 * std
        below = f"{plain(data['target'])}; {data['equation']}"
        share = as_share(p["name"], p["value"])
        below = f"{share}; {below}" if share else below
        below += f"; in the model for what is named {plain(data['names'][0])}" if law else ""
        below += "" if std is not None else "; not fitted: at the value it was weighed with"
        name = plain(p["name"])
        row = ParameterRow(name, p["value"], interval, p["unit"], None, below, std is None, joint)
        if p in slow:
            row = replace(
                row, below=f"{row.below}; damped beyond 1: where its slower pole is, about"
            )
        else:
            row = beside_bound(row, f"{data['target']}.{p['name']}")
        rows.append(row)
    return rows


def model_rows(found: Diagnosis, owner: Mapping[str, str]) -> list[ParameterRow]:
    """The model's own parameters as model.yaml states them; empty without a model."""
    if found.robot is None:
        return []
    robot, given = found.robot, found.given
    # All valves' delays are one number of the model.
    at_bound = () if found.whole is None else found.whole.held
    at_bound += (COMMAND_DELAY,) if any(n.endswith(COMMAND_DELAY) for n in at_bound) else ()
    rows = _base_rows(robot, given)
    pairs = zip(robot.cylinders, given.cylinders, strict=True)
    for now, old in pairs:
        viscous, bulk = f"{now.name}.viscous_friction", f"{now.name}.bulk_modulus"
        frictions = now.viscous_friction, old.viscous_friction
        rows.append(_row(robot, viscous, *frictions, "N s/m", at_bound))
        rows.append(_row(robot, bulk, now.bulk_modulus_pa, old.bulk_modulus_pa, "Pa"))
    for valve, earlier in zip(robot.valves, given.valves, strict=True):
        for edge in _EDGES:
            values = float(getattr(valve, edge)), float(getattr(earlier, edge))
            rows.append(_row(robot, f"{valve.name}.{edge}", *values, "m^3/(s sqrt(Pa))"))
    delays = robot.command_delay_s, given.command_delay_s
    rows.append(_row(robot, COMMAND_DELAY, *delays, "s", at_bound))
    rows += _listed_rows(robot, given)
    return [identified_row(p, owner) for p in rows]


def _listed_rows(robot: Robot, given: Robot) -> list[Parameter]:
    """Numbers of the effects that the robot file lists, as they came out and as listed."""
    now = {(one.effect.name, one.target): one for one in resolve(robot)}
    rows = []
    for listed in resolve(given):
        fitted = now.get((listed.effect.name, listed.target))
        if fitted is None:
            continue
        pairs = zip(fitted.parameters.tolist(), listed.parameters.tolist(), strict=True)
        for spec, unit, values in zip(listed.effect.parameters, listed.units, pairs, strict=True):
            name = f"{listed.target}.{listed.effect.name}.{spec.name}"
            rows.append(_row(robot, name, *values, unit))
    return rows


def _row(
    robot: Robot,
    name: str,
    value: float,
    given: float,
    unit: str,
    at_bound: Collection[str] = (),
) -> Parameter:
    std = float(robot.standard_deviations.get(name, 0.0))
    held = std <= 0.0
    as_given = value == given and name not in at_bound
    reason = (_HELD if as_given else _AT_BOUND) if held else ""
    return Parameter(name, value, std, unit, given or None, not held, reason=reason, held=held)


def _base_rows(robot: Robot, given: Robot) -> list[Parameter]:
    units = dict(zip(STANDARD_PARAMETERS, STANDARD_UNITS, strict=True))
    standard = dict(zip(given.parameter_names, given.parameter_vector.tolist(), strict=True))
    covariance = robot.base_covariance
    rows = []
    for k, base in enumerate(robot.base_parameters):
        std = 0.0 if covariance is None else float(np.sqrt(max(covariance[k, k], 0.0)))
        sheet = sum(f * standard.get(n, 0.0) for n, f in base.combination.items())
        known = std > 0.0
        reason = _UNKNOWN if np.isclose(base.value, sheet, rtol=_SAME) else _UNTOLD
        rows.append(
            Parameter(
                base.name,
                base.value,
                std,
                units[base.name.rsplit(".", 1)[-1]],
                sheet,
                known,
                base.combination,
                reason="" if known else reason,
                held=not known,
            )
        )
    return rows
