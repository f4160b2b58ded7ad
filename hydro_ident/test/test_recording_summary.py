"""What was recorded, in figures."""

from __future__ import annotations

import numpy as np

from hydro_ident.identify.recording_summary import recording_summaries
from hydro_ident.identify.survey import survey_source
from hydro_ident.recordings.sources import sources_of
from hydro_model.robot import Robot


def test_an_encoder_that_flickers_by_a_count_does_not_move(crane_run, robot: Robot) -> None:
    count = 2.0 * np.pi / robot.sensors.encoder_counts_per_rev
    q = crane_run.q.copy()
    q[:, 1] = -1.2 + count * np.random.default_rng(1).integers(0, 2, size=len(q))
    [source] = sources_of([crane_run.recording(q=q)])
    [summary] = recording_summaries([survey_source(source, robot)], 1)
    lift, tilt = summary.motion
    assert lift.moving_share > 0.5
    assert 0 < lift.reversals < 200
    assert (tilt.moving_share, tilt.reversals) == (0.0, 0)
