"""The tables of soaks on the performance page, made from the committed results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hydro_ident.bench import made
from hydro_ident.bench.page import NEVER
from hydro_ident.bench.soak import EDGES_MS
from hydro_ident.study.placed import NOT_PUBLISHED, placed, published

#: Of the results folder: alone and beside others that compute, each without and with rights.
SOAKS = ("soak.json", "soak_rt.json", "soak_busy.json", "soak_busy_rt.json")
_PROCESSES = ("bridge", "controller", "rig")


def soaks(folder: Path) -> str:
    """Soaks side by side as Markdown, with their histograms.

    Parameters
    ----------
    folder : Path
        Of the results.
    """
    runs = [(name, run) for name in SOAKS if (run := published(folder, name)) is not None]
    if not runs:
        return NOT_PUBLISHED
    names = [f"[{name}](results/{name})" for name, _ in runs]
    lines = [_row("", names), _row("---", ["---"] * len(runs))]
    lines += [_row(text, [cell(run) for _, run in runs]) for text, cell in _CELLS.items()]
    lines += [
        _row(text, [_thousands(run["histogram"][k]) for _, run in runs])
        for k, text in enumerate(_bins())
    ]
    told = [f"{name}: {made.sentence(folder, name)}" for name, _ in runs]
    return "\n".join([*lines, "", *told])


def with_soaks(text: str, folder: Path) -> str:
    """A page with the table of soaks made anew.

    Parameters
    ----------
    text : str
        The page.
    folder : Path
        Of the results.

    Raises
    ------
    IdentError
        The page has no place for it.
    """
    return placed(text, soaks(folder), "<!-- soaks: begin -->", "<!-- soaks: end -->")


def _row(text: str, cells: list[str]) -> str:
    return f"| {' | '.join([text, *cells])} |"


def _bins() -> list[str]:
    return [f"cycles up to {edge:g} ms" for edge in EDGES_MS] + ["cycles above"]


def _thousands(count: int) -> str:
    return f"{count:,}".replace(",", " ")


def _percentile(name: str) -> Callable[[Mapping[str, Any]], str]:
    def _cell(run: Mapping[str, Any]) -> str:
        found = run["latency_ms"][name]
        return NEVER if found is None else f"{found:#.3g}".rstrip(".")

    return _cell


def _grown(process: str) -> Callable[[Mapping[str, Any]], str]:
    def _cell(run: Mapping[str, Any]) -> str:
        memory = run["memory"][process]
        return f"{memory['begin']:.1f}, {memory['end']:.1f}"

    return _cell


_CELLS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "minutes": lambda run: f"{run['minutes']:g}",
    "SCHED_FIFO priority asked for": lambda run: str(run.get("rt_priority", 0)),
    "processes that compute beside it": lambda run: str(run.get("busy", 0)),
    "cycles": lambda run: _thousands(run["cycles"]),
    "trips of the gate (a command older than 10 ms)": lambda run: str(run["trips"]),
    "cycles not answered while a trip waited to be cleared": lambda run: _thousands(run["waited"]),
    "other cycles not answered": lambda run: _thousands(run["lost"] - run["waited"]),
    "p50, ms": _percentile("p50"),
    "p99, ms": _percentile("p99"),
    "p99.9, ms": _percentile("p99.9"),
    "largest, ms": _percentile("p100"),
} | {f"memory after a tenth, at the end: {one}, MiB": _grown(one) for one in _PROCESSES}
