"""The figures of `hydro_ident.study.discovered` over all machines, and their tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.study.placed import NOT_PUBLISHED, placed, published

#: Of the results folder, and the page beside it.
RESULT, PAGE = "discovered.json", "discovered.md"
BEGIN, END = "<!-- discovered: begin -->", "<!-- discovered: end -->"
ROWS = ("nominal", "identified", "discovered")
#: Goals: identified over discovered, median rho (and what is aimed at), and the worst rho.
GAIN, MEDIAN_RHO_S, AIM_RHO_S, WORST_RHO_S = 2.5, 0.0060, 0.0050, 0.0095
#: A run faster than its reference by more than this is void.
VOID_EXCESS = 0.10


def summary_of(plants: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What stands in the result as `summary`.

    Parameters
    ----------
    plants : sequence of dict
        Entries of `plants`; at least one.

    Returns
    -------
    dict
        Medians and worst by row, the ratio of maximum errors (identified over discovered) and,
        by effect, what leaving it out of the controller costs.
    """
    ratio = [_of(p, "identified") / _of(p, "discovered") for p in plants]
    return {
        "plants": len(plants),
        "rows": {row: _row(plants, row) for row in ROWS},
        "max_error_ratio": {"median": _median(ratio), "least": min(ratio)},
        "ablation": _ablation(plants),
    }


def _row(plants: Sequence[dict[str, Any]], row: str) -> dict[str, float]:
    runs = [p["rows"][row] for p in plants]
    excess = [r["max_speed_m_s"] / r["reference_speed_m_s"] - 1.0 for r in runs]
    return {
        "median_rmse_mm": _median([r["rmse_mm"] for r in runs]),
        "median_max_error_mm": _median([r["max_error_mm"] for r in runs]),
        "median_rho_s": _median([r["rho_s"] for r in runs]),
        "worst_rho_s": max(r["rho_s"] for r in runs),
        "most_speed_excess": max(excess),
        "void": sum(e > VOID_EXCESS for e in excess),
    }


def _ablation(plants: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """By name: in how many machines it was compensated, and what it costs to leave it out."""
    table: dict[str, dict[str, float]] = {}
    for name in sorted({n for p in plants for n in p["without"]}):
        pairs = [(p["without"][name], p["rows"]["discovered"]) for p in plants
                 if name in p["without"]]  # fmt: skip
        table[name] = {
            "machines": len(pairs),
            "median_max_error_ratio": _median(
                [w["max_error_mm"] / full["max_error_mm"] for w, full in pairs]
            ),
            "median_rmse_ratio": _median([w["rmse_mm"] / full["rmse_mm"] for w, full in pairs]),
            "median_max_error_mm": _median(
                [w["max_error_mm"] - full["max_error_mm"] for w, full in pairs]
            ),
        }
    return table


def _of(plant: dict[str, Any], row: str) -> float:
    return float(plant["rows"][row]["max_error_mm"])


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def summary_lines(result: dict[str, Any]) -> list[str]:
    """The tables of the docs, as Markdown.

    Parameters
    ----------
    result : dict
        The content of the result's file.

    Returns
    -------
    list of str
    """
    s = result["summary"]
    lines = [
        "| row | median RMSE mm | median max error mm | median rho s | worst rho s |"
        " largest speed excess | void |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_row_line(row, s["rows"][row]) for row in ROWS]
    lines += ["", "| | goal | measured | |", "|---|---|---|---|", *_goals(s), ""]
    lines += [
        "| left out | machines | max error, times | RMSE, times | max error, mm more |",
        "|---|---|---|---|---|",
    ]
    ranked = sorted(s["ablation"].items(), key=lambda item: -item[1]["median_max_error_ratio"])
    lines += [
        f"| {name} | {r['machines']} | {r['median_max_error_ratio']:.2f}"
        f" | {r['median_rmse_ratio']:.2f} | {r['median_max_error_mm']:+.2f} |"
        for name, r in ranked
    ]
    return lines


def table(folder: Path) -> str:
    """What the page shows of a committed result, as Markdown.

    Parameters
    ----------
    folder : Path
        Of the results.
    """
    result = published(folder, RESULT)
    if result is None:
        return NOT_PUBLISHED
    plants = result["plants"]
    command = f"{result['command']} --out {RESULT}"
    lines = [f"`{command}`, {result['date']}: {len(plants)} machines.", ""]
    lines += [*summary_lines(result), "", *_machine_lines(plants)]
    return "\n".join(lines) + "\n"


def _machine_lines(plants: Sequence[dict[str, Any]]) -> list[str]:
    """Machine by machine: largest errors, rho of the discovered row, and what was found."""
    lines = [
        "| machine | force margin | nominal mm | identified mm | discovered mm | rho s | found |",
        "|---|---|---|---|---|---|---|",
    ]
    for plant in plants:
        errors = " | ".join(f"{_of(plant, row):.2f}" for row in ROWS)
        found: dict[str, list[str]] = {}
        for one in plant["diagnosis"]["findings"]:
            found.setdefault(" or ".join(one["names"]), []).append(one["target"])
        said = ", ".join(f"{names} ({', '.join(sorted(at))})" for names, at in found.items())
        rho, margin = plant["rows"]["discovered"]["rho_s"], f"{plant['force_margin']:.0%}"
        lines.append(f"| {plant['seed']} | {margin} | {errors} | {rho:.4f} | {said} |")
    return lines


def with_table(text: str, folder: Path) -> str:
    """The page with its tables made anew.

    Raises
    ------
    IdentError
        The page has no place for them.
    """
    return placed(text, table(folder), BEGIN, END)


def _row_line(row: str, r: dict[str, float]) -> str:
    return (
        f"| {row} | {r['median_rmse_mm']:.2f} | {r['median_max_error_mm']:.2f}"
        f" | {r['median_rho_s']:.4f} | {r['worst_rho_s']:.4f} | {r['most_speed_excess']:+.1%}"
        f" | {r['void']} |"
    )


def _goals(s: dict[str, Any]) -> list[str]:
    found, ratio = s["rows"]["discovered"], s["max_error_ratio"]["median"]
    rho, worst = found["median_rho_s"], found["worst_rho_s"]
    return [
        f"| median of max error, identified over discovered | >= {GAIN} | {ratio:.2f}"
        f" | {_met(ratio >= GAIN)} |",
        f"| median rho, s | <= {MEDIAN_RHO_S:.4f} (aim {AIM_RHO_S:.4f}) | {rho:.4f}"
        f" | {_met(rho <= MEDIAN_RHO_S)} |",
        f"| worst rho, s | <= {WORST_RHO_S:.4f} | {worst:.4f} | {_met(worst <= WORST_RHO_S)} |",
    ]


def _met(good: bool) -> str:
    return "met" if good else "not met"
