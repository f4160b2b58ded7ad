"""What a case's files say from outside, and whether it tells of what is hidden.

Names, stamps, counts and sizes of every case are put to a linear classifier that is asked which
cases are clean. Its balanced accuracy on cases that it has not seen is held against that for
shuffled labels. (Compressed sizes follow from the recorded signals themselves, which may tell.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

_FOLDS, _RIDGE, _SEED = 5, 1.0, 7
#: Fewest clean cases, and others, that say anything.
_LEAST = 10


def outward(folder: Path) -> dict[str, float]:
    """Numbers that a case's files show before anyone looks at the signals.

    Parameters
    ----------
    folder : Path
        Of the case: robot files, `train` and `check` with a bag each.
    """
    files = [p for p in sorted(folder.rglob("*")) if p.is_file()]
    seen = {
        "files": float(len(files)),
        "robot_bytes": float(sum(p.stat().st_size for p in files if p.parent == folder)),
        "name": float(int(folder.name[:8], 16)),
    }
    for part in ("train", "check"):
        (bag,) = (folder / part).iterdir()
        text = (bag / "metadata.yaml").read_text(encoding="utf-8")
        facts = yaml.safe_load(text)["rosbag2_bagfile_information"]
        seen |= {
            f"{part}_name": float(int(bag.name[:8], 16)),
            f"{part}_start_s": 1e-9 * facts["starting_time"]["nanoseconds_since_epoch"],
            f"{part}_duration_s": 1e-9 * facts["duration"]["nanoseconds"],
            f"{part}_messages": float(facts["message_count"]),
            f"{part}_topics": float(len(facts["topics_with_message_count"])),
            f"{part}_text": float(len(text)),
            f"{part}_bytes": float(sum(p.stat().st_size for p in bag.glob("*.mcap"))),
        }
    return seen


def leak(truths: Sequence[Mapping[str, Any]], flips: int = 199) -> dict[str, Any] | None:
    """Whether what is seen from outside tells clean cases from others.

    Parameters
    ----------
    truths : sequence of mapping
        With `kind`, and `outward` as above.
    flips : int
        Shufflings of the labels.

    Returns
    -------
    dict or None
        `cases`, `balanced_accuracy` (0.5 by chance), `p_value`, and both without the bags'
        compressed sizes (`..._without_sizes`); None of too few cases to say.
    """
    rows = [t for t in truths if t.get("outward")]
    clean = np.array([t["kind"] == "clean" for t in rows], dtype=bool)
    if min(int(clean.sum()), int((~clean).sum())) < _LEAST:
        return None
    result: dict[str, Any] = {"cases": len(rows)}
    names = sorted(rows[0]["outward"])
    plain = [n for n in names if n not in ("train_bytes", "check_bytes")]
    for label, chosen in (("", names), ("_without_sizes", plain)):
        seen = _ranked(np.array([[t["outward"][n] for n in chosen] for t in rows]))
        accuracy = _accuracy(seen, clean)
        random = np.random.default_rng(_SEED)
        chance = [_accuracy(seen, random.permutation(clean)) for _ in range(flips)]
        result[f"balanced_accuracy{label}"] = accuracy
        reached = sum(value >= accuracy for value in chance)
        result[f"p_value{label}"] = (1 + reached) / (1 + flips)
    return result


def _ranked(seen: FloatArray) -> FloatArray:
    """Ranks from -1 to 1, ties together, and their squares: any bulge or slope shows."""
    columns = []
    for values in seen.T:
        _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
        if counts.size > 1:
            middle = np.cumsum(counts) - 0.5 * counts
            rank = 2.0 * middle[place] / values.size - 1.0
            columns += [rank, rank**2]
    return np.stack([np.ones(len(seen)), *columns], axis=1)


def _accuracy(seen: FloatArray, labels: BoolArray) -> float:
    """Balanced accuracy of a ridge classifier over folds it has not seen."""
    fold = np.arange(labels.size) % _FOLDS
    weight = np.where(labels, 0.5 / max(labels.mean(), 1e-9), 0.5 / max((~labels).mean(), 1e-9))
    guess = np.zeros(labels.size, dtype=bool)
    penalty = _RIDGE * np.eye(seen.shape[1])
    for k in range(_FOLDS):
        x, y = seen[fold != k], np.where(labels[fold != k], 1.0, -1.0)
        weighted = x * weight[fold != k][:, None]
        theta = np.linalg.solve(weighted.T @ x + penalty, weighted.T @ y)
        guess[fold == k] = seen[fold == k] @ theta > 0.0
    return float(0.5 * (np.mean(guess[labels]) + np.mean(~guess[~labels])))
