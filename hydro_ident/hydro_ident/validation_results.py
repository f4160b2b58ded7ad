"""Free run and comparison as entries of result.json and as lines for the terminal."""

from __future__ import annotations

from typing import Any

from hydro_ident.compare import LEVEL, Comparison
from hydro_ident.free_run import FreeRun


def channel_rollouts(run: FreeRun | None) -> dict[str, dict[str, float | str | None]]:
    """Roll-out entries of result.json's channels, by joint."""
    return {
        j.joint: {
            "rollout_rmse_before": j.rmse_before,
            "rollout_rmse_after": j.rmse_after,
            "rollout_unit": j.unit,
            "rollout_whole_run_rmse_before": j.whole_before,
            "rollout_whole_run_rmse_after": j.whole_after,
        }
        for j in (run.joints if run is not None else ())
    }


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
                "old_std_known": c.old_known,
                "z": c.z,
                "p_value": c.p_value,
                "p_adjusted": c.p_adjusted,
                "changed": c.changed,
            }
            for c in found.changes
        ],
        "base_parameters": None
        if base is None
        else {"chi2": base.statistic, "freedom": base.freedom, "p_value": base.p_value},
        "notes": list(found.notes),
    }


def comparison_lines(found: Comparison) -> list[str]:
    """The comparison for the terminal."""
    changed = [c.name for c in found.changes if c.changed]
    lines = [
        f"compared with {found.old}: "
        + (f"{len(changed)} parameters changed" if changed else "no parameter changed")
        + f" (5 % level, {len(found.changes)} tested, adjusted by Holm)"
    ]
    width = max((len(c.name) for c in found.changes), default=0)
    for c in found.changes:
        share = f"{100.0 * (c.new - c.old) / abs(c.old):+8.2f} %" if c.old else "         -"
        sure = "significance unknown" if c.z is None else f"z {c.z:+7.2f}, p {c.p_adjusted:.2g}"
        mark = "  CHANGED" if c.changed else ""
        lines.append(
            f"  {c.name:{width}}  {c.old:12.5g} -> {c.new:12.5g} {c.unit}  {share}  {sure}{mark}"
        )
    if found.base is not None:
        lines.append(
            f"  base parameters together: chi2 {found.base.statistic:.1f} on"
            f" {found.base.freedom}, p {found.base.p_value:.2g}"
        )
    return lines + [f"  {note}" for note in found.notes]


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
                sizes = ["rejected" if v is None else f"{v:10.4g}" for v in (before, after)]
                lines.append(
                    f"  {joint.joint + ' ' + what:14} RMSE {sizes[0]} -> {sizes[1]} {joint.unit}"
                )
    return lines
