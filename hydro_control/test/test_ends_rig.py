"""Ends, speeds and run-aways in closed loop: the shipped law on the rig's truth plant.

An ideal body does as it is asked; a loaded cylinder does not. The rig has no stop at a joint's
end: past it the lift topples over.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.following_error import FollowingLimits
from hydro_control.motion import motion_limits
from hydro_control.motion.motion_limits import limits_of
from hydro_control.motion.required_motion import Reference
from hydro_control.motion.trajectory import Waypoint
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.payload import Payload
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
TRUTH = load_truth("realistic", ROBOT)
LIMITS = limits_of(ROBOT)
MIDDLE = (0.825, -1.275)
SPEEDS = np.array([joint.velocity_limit for joint in ROBOT.joints])
#: Of the shipped limit beyond which the controller stops: 0.035 and 0.045 rad.
MARGIN = 0.02 * (LIMITS.upper - LIMITS.lower)
#: What a jumped reference may carry a joint past its end; 1.61 rad before braking was counted on
#: by what the cylinders have.
MOST_BEYOND = 0.012
NONE = np.empty(0)
#: References that jump are never reached: how far the arm is from them is not looked at here.
UNWATCHED = FollowingLimits(time_s=60.0)


@dataclass
class Loop:
    """Rig and controller, cycle by cycle; the true positions and the voltages so far."""

    core: ControllerCore
    rig: RigCore
    q: list[FloatArray] = field(default_factory=list)
    voltage_v: list[FloatArray] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    #: True pressures of the chambers A and B of every cylinder, (2, n), Pa gauge.
    chambers_pa: list[FloatArray] = field(default_factory=list)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.rig.cycle_s)):
            self._cycle()

    def _cycle(self) -> None:
        read = self.rig.readings().measurement
        pressure = np.array(read.pressures_pa) + ROBOT.atmospheric_pressure_pa
        chambers = pressure[:4].reshape(2, 2)
        stamp_ns = 10**18 + len(self.q) * 2_000_000
        lines = float(pressure[4]), float(pressure[5])
        q = np.array(read.positions)
        answer = self.core.answer(Sample(stamp_ns, q, chambers[:, 0], chambers[:, 1], *lines))
        assert answer is not None
        self.core.applied(stamp_ns, answer.output.voltage_v)
        self.rig.actuate(answer.output.voltage_v.tolist())
        plant = self.rig.plant
        self.q.append(plant.q.copy())
        self.chambers_pa.append(np.array([plant.pressures_a, plant.pressures_b]))
        self.voltage_v.append(answer.output.voltage_v)
        self.faults.append(answer.output.fault)

    def go_to(self, goal: tuple[float, ...], seconds: float) -> None:
        point = Waypoint(seconds, np.array(goal), NONE, NONE)
        self.core.requests.trajectory("joint", ROBOT.joint_names, [point])

    def beyond(self) -> FloatArray:
        """How far every joint was beyond an end at most, rad."""
        q = np.array(self.q)
        return np.asarray(np.maximum(q - LIMITS.upper, LIMITS.lower - q).max(axis=0))

    def speeds(self) -> tuple[FloatArray, float]:
        """Greatest speeds of the joints and of the tip."""
        q = np.array(self.q)
        tip = np.array([tip_position(ROBOT, row) for row in q])
        fast = [np.abs(x[5:] - x[:-5]) / 0.01 for x in (q, tip)]
        return fast[0].max(axis=0), float(np.linalg.norm(fast[1], axis=1).max())


def loop(
    start: tuple[float, ...] = MIDDLE,
    *,
    truth: Truth = TRUTH,
    payload_kg: float = 0.0,
    core: ControllerCore | None = None,
) -> Loop:
    reach = tuple(replace(j, lower=j.lower - 0.2, upper=j.upper + 0.3) for j in ROBOT.joints)
    wide = replace(ROBOT, joints=reach)  # a machine may stand where it should not
    rig = RigCore(wide, truth, seed=1, q=start, payloads=[Payload(payload_kg)])
    return Loop(core or ControllerCore(ROBOT, Gains()), rig)


def jumping(
    monkeypatch: pytest.MonkeyPatch, space: Literal["joint", "tip"], position: FloatArray
) -> ControllerCore:
    """A controller whose reference stands elsewhere from the first sample on."""
    core, still = ControllerCore(ROBOT, Gains(), following=UNWATCHED), np.zeros_like(position)
    follow: Callable[[Sample], Reference] = core._reference

    def elsewhere(sample: Sample) -> Reference:
        follow(sample)
        return Reference(space, position, still, still)

    monkeypatch.setattr(core, "_reference", elsewhere)
    return core


ELSEWHERE: dict[str, tuple[Literal["joint", "tip"], FloatArray]] = {
    "above": ("joint", LIMITS.upper + 5.0),
    "below": ("joint", LIMITS.lower - 5.0),
    "lift a little above": ("joint", np.array([LIMITS.upper[0] + 0.3, -1.5])),
    "stretched": ("tip", np.array([50.0, 0.0, 0.0])),
    "at the base": ("tip", np.zeros(3)),
    "up": ("tip", np.array([0.0, 0.0, 50.0])),
}


@pytest.mark.parametrize("name", ELSEWHERE)
def test_no_reference_carries_the_arm_past_its_ends(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    driven = loop(core=jumping(monkeypatch, *ELSEWHERE[name]))
    driven.run(6.0)
    assert not any(driven.faults)
    assert np.all(driven.beyond() < MOST_BEYOND)
    fastest, tip_m_s = driven.speeds()
    assert np.all(fastest < 1.25 * SPEEDS)
    assert tip_m_s < 1.1 * LIMITS.tip_speed_m_s
    q = np.array(driven.q[-500:])
    assert np.all(np.ptp(q, axis=0) < 5e-3)  # it stands at the end


def restless(
    monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...], tip_speed_m_s: float
) -> ControllerCore:
    """A controller whose reference stands elsewhere, and elsewhere again every 0.4 s."""
    core = ControllerCore(ROBOT, Gains(), tip_speed_m_s=tip_speed_m_s, following=UNWATCHED)
    follow: Callable[[Sample], Reference] = core._reference
    cycles = itertools.count()

    def elsewhere(sample: Sample) -> Reference:
        follow(sample)
        space, position = ELSEWHERE[names[next(cycles) // 200 % len(names)]]
        return Reference(space, position, np.zeros_like(position), np.zeros_like(position))

    monkeypatch.setattr(core, "_reference", elsewhere)
    return core


#: Where it starts, where its reference jumps to in turn, the limit of the tip and the load.
RESTLESS = {
    "from end to end": (MIDDLE, ("above", "below"), 3.0, 0.0),
    "from end to end, slowly": (MIDDLE, ("above", "below"), 0.5, 0.0),
    "from end to end, loaded": (MIDDLE, ("below", "above"), 3.0, 100.0),
    "stretched and folded": ((0.6, -0.2), ("stretched", "at the base"), 3.0, 0.0),
    "stretched and folded, slowly": ((0.6, -0.2), ("stretched", "at the base"), 0.5, 0.0),
    "round the stretched arm": ((0.6, -0.16), ("up", "stretched", "below"), 3.0, 100.0),
    "joints and tip by turns": ((0.0, -2.3), ("up", "below", "at the base", "above"), 1.0, 0.0),
}


#: Of these one asks for more than a loaded cylinder does: it ends as every run-away does.
RUNS_AWAY = "stretched and folded, slowly"


@pytest.mark.thorough
@pytest.mark.parametrize("name", RESTLESS)
def test_whatever_jumps_the_limits_are_kept_or_the_arm_is_stopped(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    start, aims, tip_m_s, payload_kg = RESTLESS[name]
    driven = loop(start, core=restless(monkeypatch, aims, tip_m_s), payload_kg=payload_kg)
    driven.run(4.0)
    voltage = np.array(driven.voltage_v)
    steps = np.abs(np.diff(voltage, axis=0, prepend=0.0)).max(axis=1)
    slew_v = Gains().slew_limit_v_s * driven.rig.cycle_s + 1e-9
    assert np.all(driven.beyond() < MARGIN)
    if name == RUNS_AWAY:
        first = next(i for i, fault in enumerate(driven.faults) if fault)
        assert re.search(r"the tip is measured at .* m/s, .*latched", driven.faults[first])
        assert set(driven.faults[first:]) == {driven.faults[first]}
        assert not np.any(voltage[first:])
        assert steps[:first].max() <= slew_v
        return
    assert not any(driven.faults)
    assert steps.max() <= slew_v
    fastest, found_m_s = driven.speeds()
    assert np.all(fastest < 1.4 * SPEEDS)
    assert found_m_s < 1.3 * tip_m_s
    assert np.ptp(np.array(driven.q), axis=0).max() > 0.1  # it moved


def test_a_chamber_loaded_beyond_its_limit_is_not_fed_and_its_peak_is_the_pages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What the valve gives is shut off there; what the load and the braking give is not.

    Also where the pump has nearly as much as the limit: below, the load alone shuts the valve.
    """
    limit_pa, peaks = ROBOT.sensors.pressure_range_pa, {}
    cases = (("round the stretched arm", 1.0), ("from end to end, loaded", 1.0))
    for name, more in (*cases, ("from end to end", 1.3)):
        start, aims, tip_m_s, payload_kg = RESTLESS[name]
        supply = replace(TRUTH.supply, pressure_pa=more * TRUTH.supply.pressure_pa)
        with monkeypatch.context() as patch:
            core, truth = restless(patch, aims, tip_m_s), replace(TRUTH, supply=supply)
            driven = loop(start, core=core, payload_kg=payload_kg, truth=truth)
            driven.run(4.0)
        assert not any(driven.faults)
        chambers, volts = np.array(driven.chambers_pa), np.array(driven.voltage_v)
        fed_beyond = (np.stack([volts, -volts], axis=1) > 1e-9) & (chambers >= limit_pa)
        assert np.sum(chambers >= limit_pa) > 100
        # Shut as fast as its voltage may go: from 10 V in five cycles.
        assert not sliding_window_view(fed_beyond, 6, axis=0).all(axis=-1).any()
        peaks[name] = 1e-5 * chambers.max()
    page = Path(__file__).parents[2] / "hydro_msgs_docs/safety_case.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    there, worst = (peaks[name] for name, _ in cases)
    assert (
        f"a chamber reaches {there:.0f} bar (from end to end and loaded {worst:.0f} bar)" in text
    )
    assert f"although it is not fed above {1e-5 * limit_pa:.0f}" in text


def test_a_payload_that_nobody_told_leaves_the_ends_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    core = jumping(monkeypatch, "joint", LIMITS.upper + 5.0)
    driven = loop(core=core, payload_kg=100.0)
    driven.run(6.0)
    assert not any(driven.faults)
    assert np.all(driven.beyond() < MOST_BEYOND)


def test_the_page_has_what_the_rig_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the six references those that carry the arm furthest, by the load that nobody told."""
    worst = {}
    for payload_kg, name in ((0.0, "above"), (200.0, "at the base"), (300.0, "at the base")):
        driven = loop(core=jumping(monkeypatch, *ELSEWHERE[name]), payload_kg=payload_kg)
        driven.run(6.0)
        worst[payload_kg] = f"{1e3 * driven.beyond().max():.1f} mrad"
    page = Path(__file__).parents[2] / "hydro_msgs_docs/safety_case.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    assert (
        f"at most {worst[0.0]} past an end, {worst[200.0]} with 200 kg more than the model knows"
        f" and {worst[300.0]} with 300 kg"
    ) in text


def counted_on_everywhere(
    robot: Robot, lower: FloatArray, upper: FloatArray, speeds: FloatArray
) -> FloatArray:
    """Braking as if every cylinder had as much at its end as in mid-range: far too late."""
    grid = np.linspace(0.0, 1.0, 65)
    span = 5.0 * (speeds * (upper - lower))[:, None]
    return np.array([span * (1.0 - grid), span * grid])


def test_a_valve_that_could_only_feed_the_pumps_line_stops_what_brakes_too_late(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Braking, a chamber is above the supply: opened, its oil would go there, and the arm on."""
    monkeypatch.setattr(motion_limits, "braking_energies", counted_on_everywhere)
    driven = loop(core=jumping(monkeypatch, "joint", LIMITS.upper + 5.0))
    driven.run(6.0)
    assert not any(driven.faults)
    assert 0.005 < driven.beyond()[0] < 0.015


def test_an_arm_that_runs_away_is_at_0_v_and_stays_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_limits, "braking_energies", counted_on_everywhere)
    # With a load that the model does not know: without one the valve that closes where it could
    # only feed the pump's line stops it 13 mrad beyond its end.
    core = jumping(monkeypatch, "joint", LIMITS.upper + 5.0)
    driven = loop(core=core, payload_kg=300.0)
    driven.run(6.0)
    first = next(i for i, fault in enumerate(driven.faults) if fault)
    assert "joint 'lift' is measured at 1.7" in driven.faults[first]
    assert "latched" in driven.faults[first]
    assert set(driven.faults[first:]) == {driven.faults[first]}
    # Told within BELIEVED samples and the cycle between plant and sample.
    at = np.array(driven.q)[first - 4 : first + 1, 0]
    assert at[0] <= LIMITS.upper[0] + MARGIN[0] <= at[-1]
    assert not np.any(driven.voltage_v[first:])
    # The closed spool holds it, long before the lever is gone at 2.14 rad.
    assert driven.beyond()[0] < 0.1
    monkeypatch.undo()
    with pytest.raises(ControlError, match=r"the controller stopped: joint 'lift' is measured"):
        driven.go_to(MIDDLE, 4.0)
    driven.core.restart()
    driven.run(0.5)
    driven.go_to((1.2, -1.0), 4.0)
    driven.run(5.0)
    assert driven.faults[-1] == ""
    assert np.abs(driven.q[-1] - [1.2, -1.0]).max() < 5e-3


@pytest.mark.parametrize(
    ("start", "back", "out"),
    [
        ((1.80, -1.5), (1.5, -1.5), (1.84, -1.5)),
        ((1.0, -2.5), (1.0, -2.1), (1.0, -2.55)),
        ((-0.09, -1.5), (0.2, -1.5), (-0.11, -1.5)),
        ((1.0, -0.05), (1.0, -0.6), (1.0, -0.02)),
    ],
)
def test_a_machine_that_stands_beyond_an_end_is_driven_back_and_never_out(
    start: tuple[float, ...], back: tuple[float, ...], out: tuple[float, ...]
) -> None:
    driven = loop(start)
    driven.run(1.0)
    # Unasked it stays where it is, but for what every hold starts with.
    assert np.abs(np.array(driven.q) - start).max() < 6e-3
    with pytest.raises(ControlError, match="cannot follow the path"):
        driven.go_to(out, 2.0)
    driven.go_to(back, 3.0)
    driven.run(4.0)
    assert not any(driven.faults)
    assert np.abs(driven.q[-1] - back).max() < 5e-3
    with pytest.raises(ControlError, match="cannot follow the path"):
        driven.go_to(start, 3.0)


def test_too_far_beyond_an_end_nothing_is_driven() -> None:
    driven = loop((1.95, -1.5))
    driven.run(0.5)
    assert "expected -0.2250 to 1.8750 to be driven back from" in driven.faults[-1]
    assert not np.any(driven.voltage_v[10:])


LITTLE_M3, MUCH_M3 = 2e-4, 1.3e-3
#: Legal trajectories from mid-range to near an end or several; oil beside the cylinders, or the
#: truth's own.
NEAR_ENDS = [
    ((0.0, -2.39), 2.0, MUCH_M3),
    ((-0.04, -2.39), 2.0, None),
    ((1.0, -2.39), 1.5, None),
    ((1.69, -2.39), 2.0, LITTLE_M3),
    ((1.69, -0.2), 2.0, LITTLE_M3),
    ((0.8, -0.16), 1.5, MUCH_M3),
    ((-0.04, -0.16), 2.0, None),
]
#: As near to the same ends, otherwise.
NEAR_AS_WELL = [
    ((0.0, -2.39), 4.0, LITTLE_M3),
    ((-0.04, -2.39), 2.0, MUCH_M3),
    ((1.69, -1.2), 2.0, MUCH_M3),
    ((1.65, -0.5), 2.0, None),
    ((-0.04, -0.16), 2.0, LITTLE_M3),
]


@pytest.mark.parametrize(
    ("goal", "seconds", "dead_m3"),
    [*NEAR_ENDS, *(pytest.param(*one, marks=pytest.mark.thorough) for one in NEAR_AS_WELL)],
)
def test_a_trajectory_to_near_an_end_settles(
    goal: tuple[float, ...], seconds: float, dead_m3: float | None
) -> None:
    """Whatever oil hoses and valve blocks hold beside the cylinder: no overshoot, no swinging."""
    cylinders = TRUTH.cylinders
    if dead_m3 is not None:
        cylinders = tuple(
            replace(c, dead_volume_a_m3=dead_m3, dead_volume_b_m3=dead_m3) for c in cylinders
        )
    # Some of these are quicker than the usual limit of the tip.
    quick = ControllerCore(ROBOT, Gains(), tip_speed_m_s=6.0)
    driven = loop(truth=replace(TRUTH, cylinders=cylinders), core=quick)
    driven.run(0.1)
    driven.go_to(goal, seconds)
    driven.run(seconds + 4.0)
    assert not any(driven.faults)
    assert np.all(driven.beyond() < 0.0)
    q, voltage = np.array(driven.q[-1000:]), np.array(driven.voltage_v[-1000:])
    # What is left are the creep and the stick-slip of an unlisted friction, and noise.
    assert np.all(np.ptp(q, axis=0) < 5e-3)
    assert np.abs(q[-1] - goal).max() < 5e-3
    assert np.all(voltage.std(axis=0) < 0.5)
