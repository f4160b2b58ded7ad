"""The robust estimator states intervals of edges and oil as least squares do on good data."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.identify.identification import Settings, identify
from hydro_ident.study.synthetic import Noise, synthetic_recording
from hydro_model.robot_files import load_robot


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
def test_robust_weights_cost_edges_and_oil_little() -> None:
    """As of forces: biweights lose a twentieth of the information where nothing is wrong.

    What an edge takes up of the delay's error comes from the same rows as the edge: those under
    the weights.
    """
    run = synthetic_recording(load_robot("xs031"), 18.0, noise=Noise(1e-5, 2e3))
    stds = []
    for estimator in ("wls", "robust"):
        found = identify(run.robot, [run], settings=Settings(estimator=estimator))
        assert found.hydraulic is not None
        assert not any(c.rejected for c in found.hydraulic.cylinders)
        stds.append(
            [std for c in found.hydraulic.cylinders for std in np.sqrt(np.diag(c.covariance))]
        )
    np.testing.assert_allclose(stds[1], stds[0], rtol=0.3)
