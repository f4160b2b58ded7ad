"""What pressures ripple by where they are read once per command, and what is known of it."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.mismatch.rows.ripple import held_ripple, in_step, known_ripple

CYCLE_S, MODULUS_PA = 0.002, 1.2e9
UNIT = MODULUS_PA * CYCLE_S / 12.0


def test_a_held_ripple_has_its_mean_taken_off() -> None:
    """Over all phases of an interval it is zero; least at its ends, largest in its middle."""
    phases = np.linspace(0.0, CYCLE_S, 2001)[:-1]
    values = np.array([held_ripple(MODULUS_PA, p, CYCLE_S) for p in phases])
    assert values.mean() == pytest.approx(0.0, abs=1e-3 * UNIT)
    assert values[0] == pytest.approx(-UNIT)
    assert values[1000] == pytest.approx(0.5 * UNIT)
    assert held_ripple(MODULUS_PA, 3.25 * CYCLE_S, CYCLE_S) == pytest.approx(values[500])


@pytest.mark.parametrize(
    ("fitted_units", "std_units", "known_units"),
    [
        (-0.9, 0.1, -1.0),  # near the phase that the delay says
        (0.1, 0.1, 0.0),  # near none
        (-0.45, 0.01, None),  # neither, and possible at another phase
        (6.0, 0.01, -1.0),  # no phase makes this
    ],
)
def test_what_is_known_of_a_ripple(
    fitted_units: float, std_units: float, known_units: float | None
) -> None:
    known = known_ripple(fitted_units * UNIT, std_units * UNIT, MODULUS_PA, 0.0, CYCLE_S)
    if known_units is None:
        assert known is None
    else:
        assert known is not None
        assert known[0] == pytest.approx(known_units * UNIT)


def test_commands_held_over_several_readings_are_not_in_step() -> None:
    u = np.sin(0.01 * np.arange(4000))
    assert in_step([u])
    assert not in_step([np.repeat(u[::5], 5)])
    assert not in_step([np.full(50, np.nan), np.zeros(50)])
