"""Rails that nobody read: that a robot file's constant is off is a note, and no finding."""

from __future__ import annotations

from collections.abc import Sequence

from hydro_ident.estimate.flows.unread_rails import UNFITTING, file_constant
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.candidates import RAIL_BIAS, RAILS
from hydro_model.robot import Robot


def parted_rails(
    work: Residuals, findings: Sequence[Finding]
) -> tuple[list[Finding], list[Finding]]:
    """Findings, and those that say that a rail's constant in the robot file is another one.

    A parameter's distance from the data sheet is no physics that was left out.

    Parameters
    ----------
    work : Residuals
        Its training tells which rails were read.
    findings : sequence of Finding

    Returns
    -------
    findings, constants : list of Finding
    """
    stretches = work.training.predictor.material.stretches
    # One bias stands for all recordings: where one has no reading, it is of the constant there.
    read = [all(s.trace.rails_read[k] for s in stretches) for k in range(len(RAILS))]
    unread = {name for name, known in zip(RAILS, read, strict=True) if not known}
    constants = [
        f
        for f in findings
        if f.named.term.effect.name == RAIL_BIAS and f.named.term.target in unread
    ]
    return [f for f in findings if f not in constants], constants


def rail_notes(robot: Robot, constants: Sequence[Finding]) -> list[str]:
    """What they are, in words.

    Parameters
    ----------
    robot : Robot
    constants : sequence of Finding
    """
    given = dict(zip(RAILS, (robot.supply_pressure_pa, robot.tank_pressure_pa), strict=True))
    notes = []
    for finding in constants:
        rail, bias_pa = finding.named.term.target, float(finding.named.term.parameters[0])
        notes.append(
            f"{file_constant(rail, given[rail])} {UNFITTING}"
            f" {1e-5 * (given[rail] - bias_pa):.4g} bar do (gauge). In the model as {RAIL_BIAS} of"
            f" {rail}, no finding: record it"
        )
    return notes
