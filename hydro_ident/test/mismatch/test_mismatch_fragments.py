"""Long recordings in many pieces: what is searched of them still tells forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_ident.identify.results import Provenance
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.answer.diagnosis_file import result_dict
from hydro_ident.mismatch.answer.outcome import MATCHES, Diagnosis
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.rows.choices import Choices
from hydro_ident.mismatch.settings import PART_S, DiagnosisSettings
from hydro_ident.mismatch.split import residuals as steps
from hydro_ident.mismatch.split.parts import spread_parts, thinly
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.recordings.sources import sources_of
from hydro_ident.report.diagnosis_views import law_views
from hydro_model.robot_files import load_robot

STEP_S = 0.002


def _cut(trace: Trace, length_s: float, number: int) -> Trace:
    """The first seconds of a trace, as a recording of its own."""
    at = slice(0, round(length_s / STEP_S))
    return replace(
        trace, label=f"bag{number}#0", time_s=trace.time_s[at], q=trace.q[at],
        stroke=trace.stroke[at], p_a=trace.p_a[at], p_b=trace.p_b[at], supply=trace.supply[at],
        tank=trace.tank[at], valve_signal=trace.valve_signal[at],
        joint_torque=trace.joint_torque[at], core=None,
    )  # fmt: skip


@pytest.mark.parametrize(
    "lengths_s",
    [
        (3.0,) * 100,
        (2.0, 4.0, 3.0) * 30,
        (1.0, 1.0, 1.0, 5.0) * 25,
        (17.0,) * 6,
        (3.0, 18.0, 9.0, 11.0, 2.0) * 4,
        (12.0,) * 30,
    ],
)
def test_no_part_is_shorter_than_a_part_or_its_trace(
    crane_run: Any, lengths_s: tuple[float, ...]
) -> None:
    (trace,) = traces_of([crane_run.recording()])
    whole = tuple(_cut(trace, s, k) for k, s in enumerate(lengths_s))
    parts = spread_parts(whole, 80.0)
    by_name = {t.recording: t for t in whole}
    for part in parts:
        longest = by_name[part.recording].samples
        assert part.samples >= min(round(PART_S / STEP_S), longest)
    taken = [(p.recording, int(c)) for p in parts for c in p.cycle + np.arange(p.samples)]
    assert len(taken) == len(set(taken))
    # Long traces are a window short, short ones may end up to half a window beyond theirs.
    assert sum(p.samples for p in parts) * STEP_S == pytest.approx(80.0, rel=0.2)
    # Spread: no fifth of what was recorded is left out.
    middles = np.cumsum(lengths_s) - 0.5 * np.array(lengths_s)
    seen = {p.recording for p in parts}
    at = middles[[t.recording in seen for t in whole]] / sum(lengths_s)
    assert np.diff([0.0, *at, 1.0]).max() < 0.2


def _pieces(run: Any, length_s: float, copies: int) -> list[Any]:
    """A run over and over, in bags of some seconds."""
    every, result = round(length_s / STEP_S), []
    for copy in range(copies):
        for begin in range(0, len(run.q) - every, every):
            at = slice(begin, begin + every)
            part = replace(
                run, q=run.q[at], p_a=run.p_a[at], p_b=run.p_b[at], voltage=run.voltage[at]
            )
            result.append(part.recording(f"bag{copy}_{begin}"))
    return result


@pytest.fixture(scope="module")
def fragmented(crane_run: Any) -> Residuals:
    """54 s in bags of 3 s, of which 20 s are searched."""
    robot = load_robot("xs031")
    sources = sources_of(_pieces(crane_run, 3.0, 3))
    surveys = [survey_source(source, robot) for source in sources]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(steps, "LONGEST_SCAN_S", 20.0)
        work = residuals(robot, sources, [], surveys, DiagnosisSettings())
    assert work is not None
    return work


def test_forces_are_searched_in_pieces_of_seconds(fragmented: Residuals) -> None:
    scan, training = fragmented.scan, fragmented.training
    assert scan is not training
    assert scan.predictor.names == training.predictor.names
    material = scan.predictor.material
    assert material.channels == training.predictor.material.channels
    counts = np.bincount(material.channel[scan.mask], minlength=len(material.channels))
    assert (counts > 50).all()
    assert not any("searched on" in note for note in fragmented.notes)


def test_channels_that_are_hardly_searched_are_told(
    fragmented: Residuals, make_run: tuple[Callable[..., Any], Callable[..., Any]]
) -> None:
    training, scan = fragmented.training, fragmented.scan
    assert thinly(training, scan, 20.0 / 54.0) == ()
    material = scan.predictor.material
    force = material.channels.index("lift/force")
    without = replace(scan, mask=scan.mask & (material.channel != force))
    (note,) = thinly(training, without, 20.0 / 54.0)
    assert note.startswith("effects are searched on 0 % of the rows of lift/force")


def _searched_without_forces(fragmented: Residuals) -> Training:
    """What is searched where no piece of it is long enough for a force."""
    training = fragmented.training
    laid = [s.trace for s in fragmented.scan.predictor.material.stretches]
    short = tuple(replace(_cut(t, 1.0, 0), label=t.label) for t in laid)
    own = steps._Laid(fragmented.robot, training.predictor.material.forces, Choices(), {})
    return steps._searched(own, short, fragmented.split, fragmented.signals, training)


def test_what_is_located_keeps_its_channel_where_the_search_lacks_some(
    fragmented: Residuals,
) -> None:
    scan = _searched_without_forces(fragmented)
    there = scan.predictor.material.channels
    assert there != fragmented.training.predictor.material.channels
    located = dependences(scan, fit(scan, fragmented.base.model))
    assert {d.name for d in located} <= set(there)
    assert all(d.name == there[d.channel] for d in located)
    found = Diagnosis(
        MATCHES, fragmented.robot, fragmented.robot, located=tuple(located),
        work=replace(fragmented, scan=scan), whole=fragmented.base,
    )  # fmt: skip
    listed = result_dict(found, Provenance("diagnose", "0", "xs031", {}, {}))["located"]
    assert [one["channel"] for one in listed] == [d.name for d in located[: len(listed)]]
    for view in law_views(found):
        assert view.title.split(" against ")[0] in there


def test_a_search_without_forces_knows_the_rest_of_the_base(fragmented: Residuals) -> None:
    """No traceback where no piece that is searched is long enough for a force."""
    training, scan = fragmented.training, _searched_without_forces(fragmented)
    assert set(scan.predictor.names) < set(training.predictor.names)
    assert training.prior is not None
    assert scan.offset(fragmented.base.model).size < training.prior.root.shape[0]
