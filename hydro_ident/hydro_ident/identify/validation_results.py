"""Free run and comparison as entries of result.json and as lines for the terminal."""

from __future__ import annotations

from typing import Any

from hydro_ident.everyday_units import bracketed
from hydro_ident.identify.compare import Comparison, JointTest
from hydro_ident.identify.significance import (
    CHANGED,
    LEVEL,
    NOT_CONCLUSIVE,
    UNCHANGED,
    Significance,
)
from hydro_ident.json_numbers import finite
from hydro_ident.rollouts.free_run import FreeRun


def channel_rollout(run: FreeRun | None, channel: str) -> dict[str, float | str | None]:
    """Roll-out entries of a channel of result.json: its joint's, null where it was not rolled out.

    Parameters
    ----------
    run : FreeRun or None
    channel : str
        `<joint>/<kind>`.

    Returns
    -------
    dict
    """
    joint = channel.rsplit("/", 1)[0]
    for j in run.joints if run is not None else ():
        if j.joint == joint:
            return {
                "rollout_rmse_before": j.rmse_before,
                "rollout_rmse_after": j.rmse_after,
                "rollout_unit": j.unit,
                "rollout_whole_run_rmse_before": j.whole_before,
                "rollout_whole_run_rmse_after": j.whole_after,
            }
    return {"rollout_rmse_before": None, "rollout_rmse_after": None, "rollout_unit": "rad"}


def free_run_dict(run: FreeRun | None) -> dict[str, object] | None:
    """The key `free_run` of result.json."""
    if run is None:
        return None
    return {
        "windows": run.windows,
        "window_s": run.window_s,
        "whole_runs": run.whole_runs,
        "rejected": list(run.rejected),
    }


def comparison_dict(found: Comparison) -> dict[str, Any]:
    """The key `compare` of result.json."""
    base = found.base
    return {
        "old": found.old,
        "level": LEVEL,
        "parameters": [
            {
                "name": c.name,
                "unit": c.unit,
                "old": c.old,
                "new": c.new,
                "change": c.new - c.old,
                "std": c.std,
                "model_error": c.model_error,
                "old_std_known": c.old_known,
                "dof": finite(c.dof),
                "z": c.z,
                **_significance_dict(c.test),
                "changed": c.changed,
            }
            for c in found.changes
        ],
        "base_parameters": None
        if base is None
        else {
            "chi2": base.statistic,
            "freedom": base.freedom,
            "dof": finite(base.dof),
            **_significance_dict(base.test),
            "changed": base.test.outcome == CHANGED,
        },
        "notes": list(found.notes),
    }


def _significance_dict(test: Significance | None) -> dict[str, float | str | None]:
    return {
        "p_value": None if test is None else test.p_value,
        "p_adjusted": None if test is None else test.p_adjusted,
        "noise_p_adjusted": None if test is None else test.noise_p_adjusted,
        "outcome": "significance unknown" if test is None else test.outcome,
    }


def comparison_lines(found: Comparison) -> list[str]:
    """The comparison for the terminal."""
    lines = [f"compared with {found.old}: {comparison_text(found)}"]
    width = max((len(c.name) for c in found.changes), default=0)
    for c in found.changes:
        share = f"{100.0 * (c.new - c.old) / abs(c.old):+8.2f} %" if c.old else "         -"
        sure = "significance unknown"
        if c.test is not None:
            sure = f"z {c.z:+7.2f}, p {c.test.p_adjusted:.2g}{_mark(c.test)}"
        lines.append(
            f"  {c.name:{width}}  {c.old:12.5g} -> {c.new:12.5g} {c.unit}  {share}  {sure}"
        )
    if found.base is not None:
        lines.append(f"  base parameters together: {joint_text(found.base)}")
    return lines + [f"  {note}" for note in found.notes]


def comparison_text(found: Comparison) -> str:
    """What changed, in a sentence."""
    outcomes = [c.test.outcome for c in found.changes if c.test is not None]
    changed, unsure = outcomes.count(CHANGED), outcomes.count(NOT_CONCLUSIVE)
    parts = [f"{changed or 'no'} parameter{'s' if changed > 1 else ''} changed"]
    if found.base is not None and found.base.test.outcome == CHANGED:
        parts.append("the base parameters together changed")
    if unsure:
        parts.append(f"{unsure} not conclusive (physics left out of the model)")
    level = f"{LEVEL:.0%} level, {len(outcomes) + (found.base is not None)} tested (Holm)"
    return f"{', '.join(parts)}; {level}"


def joint_text(base: JointTest) -> str:
    """The test of all base parameters together."""
    chance = f"p {base.test.p_adjusted:.2g}{_mark(base.test)}"
    return f"chi2 {base.statistic:.1f} on {base.freedom}, {chance}"


def _mark(test: Significance) -> str:
    if test.outcome == UNCHANGED:
        return ""
    return f"  {test.outcome.upper() if test.outcome == CHANGED else test.outcome}"


def rollout_lines(run: FreeRun | None) -> list[str]:
    """Roll-out errors for the terminal."""
    lines = []
    for joint in run.joints if run is not None else ():
        pairs = (
            ("free run", joint.rmse_before, joint.rmse_after),
            ("whole run", joint.whole_before, joint.whole_after),
        )
        for what, before, after in pairs:
            if before is not None or after is not None:
                name = f"{joint.joint} {what}"
                lines.append(f"  {name:14} RMSE {_change(before, after, joint.unit)}")
    return lines


def _change(before: float | None, after: float | None, unit: str) -> str:
    """Two sizes; of one alone what it is in everyday units stands behind it."""
    if before is not None and after is not None:
        told = bracketed((before, after), unit, " -> ")
        return f"{before:10.4g} {unit} -> {after:10.4g} {unit}{told}"
    sizes = [
        f"{'rejected':>10}" if v is None else f"{v:10.4g} {unit}{bracketed((v,), unit)}"
        for v in (before, after)
    ]
    return " -> ".join(sizes)
