"""Several clocks of one log: instants that rounding moves, and those that no cycle takes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.bag.reader import read_bag
from hydro_ident.logs.clocks import timeline_of
from hydro_ident.logs.convert import Conversion, convert
from hydro_ident.logs.file import Exact, Log, read_log
from hydro_ident.logs.joining import joined, joining_s
from hydro_ident.logs.map import read_map
from hydro_ident.logs.suggest import suggest

COUNT = 1000


def two_rates(folder: Path, apart_ms: float, every: int = 5) -> Path:
    """500 Hz beside a slower clock that is behind it, in ms as loggers write them."""
    rows = ["t1 [ms],q [deg],t2 [ms],p [barg]"]
    for k in range(COUNT):
        slow = every * k
        late = f"{2 * slow + apart_ms:.1f},{100 + slow % 7}" if slow < COUNT else ","
        rows.append(f"{2 * k:.1f},{40 + k % 9},{late}")
    file = folder / "log.csv"
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return file


def converted(log: Path, time: dict, folder: Path) -> Conversion:
    mapping = {
        "time": {"signal": "t1 [ms]", "unit": "ms", "keep": "common", **time},
        "joints": {"lift": {"signal": "q [deg]", "unit": "deg"}},
        "pressures": {
            "lift/a": {
                "signal": "p [barg]",
                "unit": "bar",
                "reference": "gauge",
                "time": "t2 [ms]",
            }
        },
    }
    file = folder / "map.yaml"
    file.write_text(yaml.safe_dump(mapping), encoding="utf-8")
    return convert(read_log(log), read_map(file), folder / "bag", {})


@pytest.mark.parametrize("given", [None, 0.001], ids=["suggested", "half a period"])
@pytest.mark.parametrize("apart_ms", [0.5, 1.0])
def test_half_a_period_apart_every_instant_finds_its_nearest(
    apart_ms: float, given: float | None, tmp_path: Path
) -> None:
    """Rounding had decided sample by sample whether 1.0 ms are within 0.001 s: half was lost."""
    log = two_rates(tmp_path, apart_ms)
    entries = {g.column: g.entry for g in suggest(read_log(log)).guesses}
    within = entries["t1 [ms]"]["within_s"]
    assert within == pytest.approx(0.0012)
    done = converted(log, {"within_s": given or within}, tmp_path)
    assert (done.cycles, done.warnings) == (COUNT // 5, ())
    stamps = read_bag(tmp_path / "bag").series["/joint_states"].stamp_ns
    # Of two that are equally near all take the earlier: the rate stays even.
    np.testing.assert_array_equal(np.diff(stamps), 10_000_000)


def test_equal_rates_half_a_period_apart_lose_no_sample(tmp_path: Path) -> None:
    done = converted(two_rates(tmp_path, 1.0, every=1), {"within_s": 0.001}, tmp_path)
    assert (done.cycles, done.warnings) == (COUNT, ())


@pytest.mark.parametrize(
    ("time", "hint"),
    [({}, True), ({"within_s": 0.0009}, True), ({"within_s": 0.0012}, False)],
)
def test_a_share_of_cycles_that_is_lost_is_warned_of(
    time: dict, hint: bool, tmp_path: Path
) -> None:
    """A clock of 3 ms beside one of 2 ms: every second instant is a period's middle."""
    log = tmp_path / "log.csv"
    rows = [f"{2 * k},{k % 9},{3 * k},{k % 7}" for k in range(COUNT + 1)]
    log.write_text("\n".join(["t1 [ms],q [deg],t2 [ms],p [barg]", *rows]), encoding="utf-8")
    found = " ".join(converted(log, {**time, "to_s": 2.0}, tmp_path).warnings)
    # Of 667 instants until the end, 333 fall between two of the finest.
    assert ("333 of 667 instants are further than" in found) == hint
    assert ("time: {within_s: 0.0012} would keep them" in found) == hint


@pytest.mark.parametrize(
    ("slow_ms", "own_ms", "rows", "left"),
    [
        ([-1, 1, 3, 5], [-1], [0, 1, 2, 3], 1),
        ([1.1, 2.9, 6, 8.5], [1.1], [1, 2, 4, 5], 1),
        ([1.2, 2.1, 2.9, 5.6, 8, 10.4], [1.2, 2.9], [1, 2, 3, 5, 6, 7], 2),
        ([1, 3, 5], [], [0, 1, 2], 0),
    ],
    ids=["before the first", "equally near", "nearest", "none"],
)
def test_no_two_samples_of_a_clock_are_in_one_cycle(
    slow_ms: list[float], own_ms: list[float], rows: list[int], left: int
) -> None:
    """The earlier one had been written over, unsaid."""
    fast_ms = np.arange(0.0, 11.0, 2.0)
    times = {"": fast_ms * 1e-3, "slow": np.array([*slow_ms, np.nan]) * 1e-3}
    cycles, found, remarks, _ = joined(times, joining_s(2e-3))
    np.testing.assert_allclose(cycles, np.union1d(fast_ms, own_ms) * 1e-3, atol=1e-12)
    np.testing.assert_array_equal(found["slow"], [*rows, -1])
    np.testing.assert_allclose(cycles[found[""]], times[""], atol=1e-12)
    said = f"clock 'slow': {left} instants have cycles of their own, as another of the same clock"
    assert any(remark.startswith(said) for remark in remarks) == bool(left)


def test_every_sample_is_in_a_cycle_of_its_own_or_moved_by_no_more_than_asked() -> None:
    """Three clocks that jitter, joined by several shares of a period."""
    rng = np.random.default_rng(7)
    for share in (0.0, 0.2, 0.6, 3.0):
        times = {
            name: np.cumsum(rng.uniform(0.2, 1.8, 400)) * step + rng.uniform(-step, step)
            for name, step in {"": 2e-3, "b": 2.1e-3, "c": 5e-3}.items()
        }
        cycles, rows, _, _ = joined(times, share * 2e-3)
        assert (np.diff(cycles) > 0.0).all()
        for name, instants in times.items():
            assert len(np.unique(rows[name])) == len(instants)
            moved = np.abs(cycles[rows[name]] - instants)
            assert moved.max() <= max(share, 0.05) * 2.2e-3 + 1e-9
        assert set(np.concatenate(list(rows.values()))) == set(range(len(cycles)))


@pytest.mark.parametrize("unit", ["s", "ms", "ns"])
@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("first", [0, 7, 1_773_307_800])
def test_limits_take_the_samples_that_stand_at_them(
    first: int, exact: bool, unit: str, tmp_path: Path
) -> None:
    """A double of seconds since 1970 misses what was written by up to 0.12 us."""
    steps_ms = 1000 * first + 2 * np.arange(500)
    per_ms = {"s": 1e-3, "ms": 1.0, "ns": 1e6}[unit]
    columns = {"t": steps_ms * per_ms, "q": np.arange(500.0)}
    whole = {"t": Exact(steps_ms * 10**6) if unit == "ns" else Exact(steps_ms, 3 * (unit == "s"))}
    log = Log(tmp_path / "log.csv", columns, exact=whole if exact else {})
    mapping = {
        "start": "1970-01-01T00:00:00Z",
        "time": {"signal": "t", "unit": unit},
        "joints": {"lift": {"signal": "q", "unit": "deg"}},
    }
    for begin, end in [(2, 6), (14, 402), (58, 998), (128, 384)]:
        limits = {"from_s": first + begin / 1000, "to_s": float(f"{first}.{end:03d}")}
        mapping["time"] |= limits
        (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping), encoding="utf-8")
        rows = timeline_of(log, read_map(tmp_path / "map.yaml")).rows[""]
        np.testing.assert_array_equal(np.flatnonzero(rows >= 0), np.arange(begin, end + 1, 2) // 2)
