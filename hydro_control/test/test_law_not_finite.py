"""What is no number leaves the law as 0 V with its name, and nothing of it behind."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from hydro_control.gains import Gains
from hydro_control.law.law import ControlLaw, Output
from hydro_control.motion.required_motion import Reference
from hydro_model.robot import EffectSpec, FloatArray
from hydro_model.robot_files import load_robot

DATASHEET = load_robot("xs031")
#: It looks ahead.
LATE = replace(DATASHEET, effects=(EffectSpec("command_delay", "xs031", {"delay": 0.006}),))
POSE, STILL = np.array([0.6, -1.5]), np.zeros(2)
P_S, P_T = 19.0e6, 1.0e6
DT = 0.002
HOLD = Reference("joint", POSE + 0.01, STILL, STILL)
USUAL = np.full(2, 8.0e6), np.full(2, 6.0e6)
#: The chamber that retracting feeds is above the supply: a valve is kept shut against that, and a
#: flow term that is no number counts as such. The signal is 0 then, as if all were well.
SHUT = np.full(2, P_T), np.full(2, P_S + 5e6)


def answers(
    law: ControlLaw,
    cycles: range,
    reference: Reference = HOLD,
    ahead: Reference = HOLD,
    chambers: tuple[FloatArray, FloatArray] = USUAL,
) -> Output:
    """The last answer of some cycles."""
    for k in cycles:
        output = law.step(k * DT, POSE, *chambers, P_S, P_T, reference, ahead)
    return output


def assert_at_0_v_and_forgotten(law: ControlLaw, output: Output, said: str) -> None:
    """The next samples are answered, bit for bit, as the first ones of a law that is new."""
    np.testing.assert_array_equal(output.voltage_v, 0.0)
    assert said in output.fault
    new = ControlLaw(law.robot, law.gains)
    for k in range(20, 23):
        found, expected = (answers(one, range(k, k + 1)) for one in (law, new))
        assert np.any(found.voltage_v)
        for field in fields(Output):
            np.testing.assert_array_equal(
                getattr(found, field.name), getattr(expected, field.name), err_msg=field.name
            )


@pytest.mark.parametrize("chambers", [USUAL, SHUT], ids=["usual", "shut"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("part", ["position", "velocity", "acceleration"])
def test_a_reference_ahead_that_is_no_number(
    part: str, bad: float, chambers: tuple[FloatArray, FloatArray]
) -> None:
    law = ControlLaw(LATE, Gains())
    assert law.lead_s > 0.0
    answers(law, range(10), chambers=chambers)
    wrong = replace(HOLD, **{part: np.array([0.5, bad])})
    output = answers(law, range(10, 11), ahead=wrong, chambers=chambers)
    assert_at_0_v_and_forgotten(law, output, f"reference {part} looked ahead to [0.5, {bad}]")


def test_numbers_from_which_none_follows_though_the_valves_are_kept_shut() -> None:
    """The required force is none then, and so is its rate, which the next samples start from."""
    law = ControlLaw(LATE, Gains())
    assert answers(law, range(10), chambers=SHUT).fault == ""
    far = replace(HOLD, position=np.array([5e307, 0.0]))
    output = answers(law, range(10, 11), far, far, SHUT)
    assert_at_0_v_and_forgotten(law, output, "flow term [nan, ")
