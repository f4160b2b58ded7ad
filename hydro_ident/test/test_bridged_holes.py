"""Lost messages: short holes are bridged, long ones part a recording, all is owned once."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import Piece, cut_recording
from hydro_ident.estimate.signals.bridging import Stretch, stretches
from hydro_ident.estimate.signals.traces import traces_of, traces_of_piece
from hydro_ident.identify.identification import Settings, identify
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

PERIOD_NS = 2_000_000
NOTHING_HELD_OUT = Settings(hold_out_every=0)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return synthetic_recording(load_robot("xs031"), 20.0, seed=3)


def _without(recording: Recording, lost: np.ndarray) -> Recording:
    """The recording without some cycles, as where their messages never came."""
    kept = np.setdiff1d(np.arange(len(recording)), lost)
    columns: dict[str, Any] = {
        name: getattr(recording, name)[kept]
        for name in ("stamp_ns", "q", "p_a", "p_b", "valve_v", "latched", "supply", "tank")
        if getattr(recording, name) is not None
    }
    whole = cut_recording(recording, slice(0, len(kept)))
    rest = {
        name: getattr(recording, name)[kept]
        for name in ("stroke", "effort", "command_v", "spool", "q_ref", "qd_ref", "force_ref",
                     "tip_ref")
        if getattr(recording, name) is not None
    }  # fmt: skip
    return replace(whole, **columns, **rest)


def test_a_lost_cycle_is_as_good_as_read(recording: Recording) -> None:
    lost = np.arange(100, len(recording) - 100, 150)
    lost = np.sort(np.concatenate([lost, lost[::3] + 1]))
    (whole,), (bridged,) = traces_of([recording]), traces_of([_without(recording, lost)])
    assert bridged.samples == whole.samples
    np.testing.assert_allclose(bridged.time_s, whole.time_s, atol=1e-9)
    kept = np.setdiff1d(np.arange(whole.samples), lost)
    for name in ("q", "stroke", "p_a", "p_b", "supply", "tank"):
        before, after = getattr(whole, name), getattr(bridged, name)
        assert np.array_equal(before[kept], after[kept]), name
        # In a hole as near as readings of a sensor are to what goes smoothly through them.
        noise = np.std(np.diff(before, 4, axis=0), axis=0) / np.sqrt(70.0)
        off = np.sqrt(np.mean((before[lost] - after[lost]) ** 2, axis=0))
        assert (off <= 3.0 * noise + 1e-6).all(), name
    assert (whole.bridged, bridged.bridged) == (0, lost.size)
    # Nobody knows what the valve was told.
    assert np.isnan(bridged.valve_signal[lost]).all()
    assert np.array_equal(bridged.valve_signal[kept], whole.valve_signal[kept])


def test_a_hole_of_a_cubic_is_filled_exactly(recording: Recording) -> None:
    t = 1e-3 * np.arange(len(recording))
    cubic = np.stack([1.0 + t - 0.3 * t**2 + 0.01 * t**3, 2.0 - t**3 / 7.0], axis=1)
    smooth = replace(recording, q=cubic)
    (whole,), (bridged,) = (
        traces_of([one]) for one in (smooth, _without(smooth, np.array([500, 501, 502, 900])))
    )
    np.testing.assert_allclose(bridged.q, whole.q, rtol=1e-12)


def test_a_long_hole_parts_a_recording(recording: Recording) -> None:
    """Six cycles of 2 ms are longer than 10 ms; five are not, and a cycle without a reading."""
    lost = np.concatenate([np.arange(1000, 1005), np.arange(2000, 2006)])
    first, second = traces_of([_without(recording, lost)])
    assert (first.samples, second.cycle) == (2000, 2006)
    silent = recording.q.copy()
    silent[1000:1005, 0] = silent[2000:2006, 1] = np.nan
    traces = traces_of([replace(recording, q=silent)])
    assert [t.samples for t in traces] == [2000, len(recording) - 2006]
    assert np.isfinite(traces[0].q).all()


def test_a_slow_recording_may_lose_a_cycle() -> None:
    stamps = np.arange(20, dtype=np.int64) * 50_000_000
    stamps[10:] += 50_000_000
    stamps[15:] += 100_000_000
    parts = [slice(0, 10), slice(10, 15), slice(15, 20)]
    assert stretches(parts, stamps, 0.05) == [
        Stretch((parts[0], parts[1]), (1,)),
        Stretch((parts[2],)),
    ]


@settings(deadline=None, max_examples=60)
@given(
    lost=st.sets(st.integers(2, 397), max_size=120),
    cuts=st.lists(st.integers(1, 399), max_size=4),
    overlap=st.integers(0, 60),
    jitter=st.integers(0, 600_000),
)
def test_pieces_own_every_cycle_once(
    lost: set[int], cuts: list[int], overlap: int, jitter: int
) -> None:
    """However a recording is cut into pieces: what is owned follows on, and is owned once."""
    random = np.random.default_rng(len(lost))
    stamps = PERIOD_NS * np.arange(400, dtype=np.int64) + random.integers(0, jitter + 1, 400)
    kept = np.setdiff1d(np.arange(400), sorted(lost))
    stamps = stamps[kept]
    gaps = np.flatnonzero(np.diff(stamps) > 1.5 * PERIOD_NS) + 1
    parts = [slice(int(a), int(b)) for a, b in zip([0, *gaps], [*gaps, len(kept)], strict=True)]
    parts = [p for p in parts if p.stop - p.start >= 2]
    edges = [0, *sorted({c for c in cuts if c < len(kept)}), len(kept)]
    owned = []
    for begin, end in pairwise(edges):
        from_, to = max(begin - overlap, 0), min(end + overlap, len(kept))
        seen = [slice(max(p.start, from_) - from_, min(p.stop, to) - from_) for p in parts]
        seen = [p for p in seen if p.stop - p.start >= 2]
        core = slice(begin - from_, end - from_)
        for one in stretches(seen, stamps[from_:to], 1e-9 * PERIOD_NS):
            own = one.core(core)
            if own is None:
                continue
            at, begins = list[int](), 0
            for part, hole in zip(one.parts, (*one.holes, 0), strict=True):
                at += range(from_ + part.start, from_ + part.stop)
                at += [-1] * hole
                begins += part.stop - part.start + hole
            assert 0 <= own[0] < own[1] <= begins
            owned += [cycle for cycle in at[own[0] : own[1]] if cycle >= 0]
    assert owned == sorted(set(owned))
    # With room to either side nothing is lost at a cut, either.
    if overlap > 20 and not lost:
        assert owned == [c for p in parts for c in range(p.start, p.stop)]


@pytest.mark.needs("clarabel")
def test_lost_messages_change_no_result(recording: Recording) -> None:
    """Every 0.3 s a message less: no stretch is long enough, and all is told as before."""
    lost = np.arange(70, len(recording) - 70, 150)
    before, after = (
        identify(load_robot("xs031"), [one], settings=NOTHING_HELD_OUT)
        for one in (recording, _without(recording, lost))
    )
    assert after.verdict == before.verdict
    # Told, and how many.
    said = [note for note in after.notes if "are bridged between" in note]
    assert [n.split(": ")[1].split(" ")[0] for n in said] == [str(lost.size)]
    assert not any("are bridged between" in note for note in before.notes)
    for one, other in zip(before.parameters, after.parameters, strict=True):
        # Within both intervals.
        allowed = 1.96 * np.hypot(one.std, other.std)
        assert other.value == pytest.approx(one.value, abs=allowed), one.name


@pytest.mark.thorough
def test_an_effect_is_found_where_messages_are_lost(crane_run: Any, make_run: Any) -> None:
    true_crane, simulated_run = make_run
    friction = EffectSpec("coulomb_friction", "tilt_cylinder", {"force": 400.0})
    whole = simulated_run(replace(true_crane(), effects=(friction,)), 14.0).recording()
    lost = np.arange(40, len(whole) - 40, 110)
    found = diagnose(crane_run.robot, [_without(whole, lost)])
    assert any(f": {lost.size} cycles without a reading" in note for note in found.notes)
    (finding,) = found.findings
    assert finding.named.names[0] == "coulomb_friction"
    assert finding.named.term.parameters[0] == pytest.approx(400.0, rel=0.1)


def test_holes_of_a_piece_reach_its_filters(recording: Recording) -> None:
    """A piece knows what is beyond its core also behind a hole at the core's end."""
    holed = _without(recording, np.array([999, 1500]))
    start_ns = int(holed.stamp_ns[0])
    (whole,) = traces_of([holed])
    piece = Piece(cut_recording(holed, slice(700, 1400)), slice(299, 500), start_ns)
    (trace,) = traces_of_piece(piece)
    own = slice(trace.cycle + trace.owned.start, trace.cycle + trace.owned.stop)
    assert np.array_equal(trace.q[trace.owned], whole.q[own])
    assert trace.samples > trace.owned.stop > trace.owned.start > 0
