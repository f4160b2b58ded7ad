"""The compiled filters over the sensors against their readable twin, on random samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.gains import Gains
from hydro_control.state.axes import axes_of
from hydro_control.state.filters import FilteredDifference
from hydro_control.state.state import State, StateFilter
from hydro_control.state.state_kernels import difference_kernel
from hydro_control.state.state_reference import ReadableStateFilter
from hydro_model.robot_files import load_robot

DT = 0.002
CRANE = load_robot("xs031")
#: Cylinders in another order than the joints.
ROBOT = replace(CRANE, cylinders=CRANE.cylinders[::-1])
GAINS = {
    "shipped": Gains(),
    "smooth": replace(Gains(), alpha_q=0.3, alpha_qd=0.05, alpha_p=0.1),
    "unfiltered": replace(Gains(), alpha_q=1.0, alpha_qd=1.0, alpha_p=1.0),
}


def agree(found: State, expected: State) -> None:
    for field in ("q", "qd", "force", "pressures", "p_s", "p_t"):
        wanted = getattr(expected, field)
        size = float(np.max(np.abs(wanted)))
        np.testing.assert_allclose(getattr(found, field), wanted, rtol=1e-12, atol=1e-13 * size)


@pytest.mark.parametrize("name", GAINS)
def test_measured_and_predicted_states_are_those_of_the_filters(name: str) -> None:
    rng = np.random.default_rng(3)
    given = axes_of(ROBOT), GAINS[name], DT, np.array([0.0, 0.004])
    compiled, readable = StateFilter(*given), ReadableStateFilter(*given)
    earlier: list[tuple[State, State]] = []
    for k in range(50):
        if k == 30:
            compiled.reset()
            readable = ReadableStateFilter(*given)
        q, pressures = rng.normal(size=2), rng.uniform(-1e5, 26e6, (2, 2))
        sample = q, pressures, rng.uniform(5e6, 21e6), rng.uniform(0.0, 1e6), 1 + k % 3
        found, expected = compiled.measured(*sample), readable.measured(*sample)
        agree(found, expected)
        asked = 0.02 * rng.uniform(), rng.normal(size=2), rng.normal(size=2) * 1e6
        agree(compiled.predicted(found, *asked), readable.predicted(expected, *asked))
        earlier.append((found, expected))
    for found, expected in earlier:  # no sample is written over by a later one
        agree(found, expected)


@pytest.mark.parametrize("alpha", [0.05, 0.3, 1.0])
def test_the_compiled_difference_is_the_filtered_difference(alpha: float) -> None:
    rng = np.random.default_rng(4)
    readable, kept = FilteredDifference(alpha, DT), np.full((2, 3), np.nan)
    for k in range(30):
        z, steps, out = rng.normal(size=3), 1 + k % 3, np.empty(3)
        difference_kernel(kept, z, (1.0 - alpha) ** steps, steps * DT, out)
        np.testing.assert_allclose(out, readable.update(z, steps), rtol=1e-12, atol=1e-10)
