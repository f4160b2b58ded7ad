"""The simulated rig's side file: the true tip, put on the stamps of a recording.

Truth never travels on a topic. The file counts device samples; `/diagnostics` of the bridge says
which stamp sample 0 has (`sample_zero_stamp_ns`).
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.reader import Bag
from hydro_ident.bag.recording import Recording
from hydro_ident.errors import BagError

#: What the rig writes into its file (`hydro_hw_bridge.rig.truth_log`).
SCHEMA = "hydro_hw_bridge/truth_log/1"
ZERO_STAMP_KEY = "sample_zero_stamp_ns"
#: Encoders whose zeros are off (0.05 rad, at a reach of some metres), bending links and lash put
#: the tip of a run elsewhere by no more than this in the median, m.
_OTHER_RUN_M = 0.5
_COLUMNS = ("counter", "tip/x", "tip/y", "tip/z")


def true_tip_m(
    path: Path, bag: Bag, recording: Recording, encoders_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The true tip at each cycle of a recording.

    Every run begins at sample 0, so that the counters alone would let any run's file pass.

    Parameters
    ----------
    path : Path
        `.npz` with `schema`, `names` (k,) and `rows` (K, k): columns `counter`, `tip/x`, `tip/y`,
        `tip/z`.
    bag : Bag
        The recording's bag, with its diagnostics.
    recording : Recording
    encoders_m : (N, 3) array
        The tip by the encoders at each cycle.

    Returns
    -------
    (N, 3) array
        m; NaN for cycles that the file does not hold.

    Raises
    ------
    BagError
        Unreadable file or one of another schema, no stamp of sample 0 in the bag, no cycle in
        common, or a tip that is somewhere else than the encoders' throughout.
    """
    counter, tip_m = _read(path)
    period_ns = round(1e9 / recording.robot.sensors.rate_hz)
    stamp_ns = _zero_stamp_ns(bag) + counter * period_ns
    stamp_ns, first = np.unique(stamp_ns, return_index=True)
    at = np.minimum(np.searchsorted(stamp_ns, recording.stamp_ns), len(stamp_ns) - 1)
    there = stamp_ns[at] == recording.stamp_ns
    if not there.any():
        raise BagError(f"{path}: no sample of this file has a stamp of {bag.path}")
    tip = np.full((len(recording), 3), np.nan)
    tip[there] = tip_m[first[at[there]]]
    apart = np.linalg.norm(tip - encoders_m, axis=1)
    known = apart[np.isfinite(apart)]
    if known.size and (median_m := float(np.median(known))) > _OTHER_RUN_M:
        raise BagError(
            f"{path}: expected the true tip within {_OTHER_RUN_M:g} m of the encoders' in"
            f" {bag.path}, found it {median_m:.3g} m away (median): is this file of another run,"
            " or the robot another one?"
        )
    return tip


def _read(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Sample counters (K,) and true tips (K, 3)."""
    try:
        with np.load(path, allow_pickle=False) as data:
            schema = str(data["schema"])
            names = [str(name) for name in data["names"]]
            rows = np.asarray(data["rows"], dtype=np.float64)
    except KeyError as error:
        raise BagError(
            f"{path}: expected arrays schema, names and rows: {error.args[0]}"
        ) from error
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise BagError(f"{path}: expected the rig's .npz side file: {why}") from error
    if schema != SCHEMA:
        raise BagError(f"{path}: expected schema {SCHEMA}, found '{schema}'")
    absent = [name for name in _COLUMNS if name not in names]
    if absent:
        raise BagError(f"{path}: expected a column {absent[0]}, found {', '.join(names)}")
    if rows.ndim != 2 or rows.shape[1] != len(names) or not len(rows):
        raise BagError(f"{path}: expected rows of {len(names)} columns, found {rows.shape}")
    picked = rows[:, [names.index(name) for name in _COLUMNS]]
    return np.rint(picked[:, 0]).astype(np.int64), picked[:, 1:]


def _zero_stamp_ns(bag: Bag) -> int:
    texts = [s.values[ZERO_STAMP_KEY] for s in bag.diagnostics if ZERO_STAMP_KEY in s.values]
    stamps = [int(text) for text in texts if text.lstrip("-").isdigit()]
    if not stamps:
        raise BagError(
            f"{bag.path}: expected {ZERO_STAMP_KEY} in /diagnostics, found none: the side file"
            " cannot be put on this bag's stamps"
        )
    return stamps[-1]
