"""The law as a whole against its readable parts put together, sample after sample."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from hydro_control.compensation.compensation import Motion
from hydro_control.compensation.compensation_reference import ReadableCompensation
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law import law_reference
from hydro_control.law.law import ControlLaw, Output
from hydro_control.motion.motion_limits import limits_of
from hydro_control.motion.required_motion import Reference, desired_at
from hydro_control.state.axes import axes_of
from hydro_control.state.filters import FilteredDifference
from hydro_control.state.oil_columns import OilColumns
from hydro_control.state.state_reference import ReadableStateFilter
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot

DT = 0.002
CRANE = load_robot("xs031")
GAINS = replace(Gains(), alpha_q=0.5, alpha_qd=0.2, alpha_p=0.3, k_v=7e3)
EFFECTS = (
    EffectSpec("coulomb_friction", "xs031", {"force": 3e3}),
    EffectSpec("presliding_friction", "lift_cylinder", {"force": 1e3, "distance": 1e-4}),
    EffectSpec("dead_volume", "xs031", {"volume_a": 1.2e-3, "volume_b": 0.8e-3}),
    EffectSpec("internal_leakage", "xs031", {"coefficient": 4e-12}),
    EffectSpec("valve_deadband", "lift_valve", {"width": 0.02}),
    EffectSpec("valve_spool_lag", "xs031", {"frequency": 80.0, "damping": 0.8}),
    EffectSpec("pressure_delay", "lift_cylinder/a", {"delay": 0.004}),
)
ROBOTS = {
    "listed": replace(CRANE, effects=EFFECTS, cylinders=CRANE.cylinders[::-1]),
    "base": CRANE,
}


class ReadableLaw:
    """`ControlLaw.step`, of what its kernels are tested against one by one."""

    def __init__(self, law: ControlLaw, robot: Robot) -> None:
        self.robot, self.axes, self.limits = law.robot, axes_of(robot), limits_of(robot)
        listed = law.compensation
        self.lead_s = law.lead_s
        late = np.zeros(2) if listed is None else listed.force_lag_s
        self.state = ReadableStateFilter(self.axes, GAINS, DT, late)
        self.listed = ReadableCompensation(robot, law.plan.active, self.axes, DT)
        self.rate = FilteredDifference(GAINS.alpha_fd, DT)
        self.asked = np.zeros(2), np.zeros(2)
        self.voltage_v = np.zeros(2)

    def step(  # the names are those of `ControlLaw.step`
        self,
        steps: int,
        stamp_s: float,
        q: FloatArray,
        oil: tuple[FloatArray, float, float],
        reference: Reference,
        ahead: Reference | None,
    ) -> dict[str, FloatArray]:
        """What an `Output` of the sample should hold."""
        now = then = self.state.measured(q, *oil, steps)
        if ahead is not None:
            then = self.state.predicted(now, self.lead_s, *self.asked)
        given = self.robot, self.axes, self.limits, GAINS, then
        asked, motion = law_reference.required(*given, ahead or reference)
        desired = motion if ahead is None else desired_at(self.robot, now.q, reference, motion)
        self.listed.observe(
            Motion(
                *(stamp_s, then.q, asked.qd_r, asked.qdd_r, asked.arm, asked.x),
                *(now.pressures, now.p_s, now.p_t, now.force),
            )
        )
        columns = self.listed.columns(OilColumns(asked.length_a, asked.length_b))
        asked = asked._replace(force_d=asked.force_d + self.listed.friction())
        rate = self.rate.update(asked.force_d, steps)
        self.asked = asked.qdd_r, rate
        flow = law_reference.flow_term(self.axes, GAINS, then, asked, rate, columns)
        opening = law_reference.openings(self.axes, flow, columns, then)
        signal = self.listed.signals(opening, steps)
        most = self.voltage_v, GAINS.slew_limit_v_s * DT
        of_valves = self.axes, self.limits, signal, now.pressures
        self.voltage_v = law_reference.voltages(*of_valves, *most)
        return {
            "voltage_v": self.voltage_v,
            "valve_signal": signal,
            "flow_term": flow,
            "required_force_n": asked.force_d,
            "force_n": now.force,
            "required_piston_velocity_m_s": asked.xd_r,
            "piston_velocity_m_s": asked.arm * now.qd,
            "q_d": desired.q_d,
            "qd_d": desired.qd_d,
            "tip_d_m": desired.tip_d_m,
        }


def references(robot: Robot, space: Literal["tip", "joint"], t: float) -> Reference:
    """A slow swing of the joints, or of the tip."""
    middle = np.array([0.5, -1.4])
    at = middle if space == "joint" else np.asarray(tip_position(robot, middle))
    turn, size = 2.0 * np.pi * np.arange(1, len(at) + 1), 0.03
    waves = size * np.sin(turn * t), size * turn * np.cos(turn * t)
    return Reference(space, at + waves[0], waves[1], -size * turn**2 * np.sin(turn * t))


def agree(found: Output, expected: dict[str, FloatArray]) -> None:
    for name, wanted in expected.items():
        size = float(np.max(np.abs(wanted)))
        np.testing.assert_allclose(
            getattr(found, name), wanted, rtol=1e-8, atol=1e-9 * size + 1e-12, err_msg=name
        )


@pytest.mark.parametrize("space", ["tip", "joint"])
@pytest.mark.parametrize("name", ROBOTS)
def test_a_sample_is_answered_as_its_readable_parts_say(
    name: str, space: Literal["tip", "joint"]
) -> None:
    robot, rng, stamp = ROBOTS[name], np.random.default_rng(8), 0
    law = ControlLaw(robot, GAINS)
    readable = ReadableLaw(law, law.robot)
    assert (law.lead_s > 0.0) == (name == "listed")
    for k in range(60):
        steps = 3 if k % 10 == 9 else 1
        stamp += steps
        t = stamp * DT
        q = references(robot, "joint", t).position + 1e-3 * rng.normal(size=2)
        p_a, p_b = rng.uniform(6e6, 9e6, (2, 2))
        reference = references(robot, space, t)
        ahead = references(robot, space, t + law.lead_s) if law.lead_s else None
        found = law.step(t, q, p_a, p_b, 19e6, 1e6, reference, ahead)
        assert not found.fault
        oil = np.array([p_a, p_b]), 19e6, 1e6
        agree(found, readable.step(steps if k else 1, t, q, oil, reference, ahead))


@pytest.mark.parametrize(("joints", "cylinders"), [(1, 2), (3, 2), (2, 1), (2, 3)])
def test_a_sample_of_another_machine_is_refused(joints: int, cylinders: int) -> None:
    law, still = ControlLaw(CRANE, GAINS), np.zeros(2)
    oil, reference = np.full(cylinders, 8e6), Reference("joint", still, still, still)
    with pytest.raises(ControlError, match=r"expected positions and pressures of 2 joints"):
        law.step(0.0, np.zeros(joints), oil, oil, 19e6, 1e6, reference)
