"""The controller without ROS: samples in, answers out, one answer per stamp.

What it answers depends on the samples and requests alone, never on a clock, so a recording fed
to it again gives the same answers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hydro_control.adaptation.adaptation_settings import AdaptationSettings
from hydro_control.core.answer import Answer, Counts, Untold
from hydro_control.core.motion_requests import MotionRequests, OwnPath
from hydro_control.core.warm_up import warm_up
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law.law import ControlLaw
from hydro_control.law.output import Output
from hydro_control.monitoring.applied import AppliedWatch
from hydro_control.monitoring.bad_samples import BadSampleWatch
from hydro_control.monitoring.following_error import FollowingLimits, FollowingWatch
from hydro_control.monitoring.runaway import RunawayLimits, RunawayWatch
from hydro_control.monitoring.stamps import StampWatch
from hydro_control.motion.motion_limits import TIP_SPEED_M_S
from hydro_control.motion.reference_run import ReferenceRun
from hydro_control.motion.required_motion import Reference
from hydro_control.state.sample import Sample
from hydro_control.state.sensor_correction import SensorCorrection
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.robot import FloatArray, Robot

__all__ = ["Answer", "ControllerCore", "Counts", "Sample"]

_SECOND_NS = 1_000_000_000
_WITHHELD = "the valves do not get the commands"


@dataclass
class ControllerCore:
    """The controller of one robot.

    Listed effects of instruments are taken off every sample before anything looks at it: the
    reference, and what is published of it, are in true positions.

    `counts` and `untold` are what the core says of itself: they start empty. Motions are asked of
    `requests`.

    Parameters
    ----------
    robot : Robot
    gains : Gains
    path : TipPath or JointPath, optional
        Played from the first sample on. What holds from every pose is checked at once, the rest
        from the pose of that sample where this makes a difference.
    start_delay_s : float
        Hold before the path.
    adaptation : AdaptationSettings, optional
        Off by default.
    tip_speed_m_s : float
        Paths beyond it are refused, faster required motion is slowed.
    runaway : RunawayLimits, optional
        What measured motion ends in 0 V until `restart`; by default the shipped limits.
    following : FollowingLimits, optional
        From when on an arm does not follow: its motion is dropped and it is held where it is, or,
        where it was only held, at 0 V until `restart`; by default the shipped limits.
    checks_beside : bool
        Hold until somebody beside the samples' thread has called
        `requests.check_waiting_path`; by default the answer to the first sample takes as long as
        the check.

    Raises
    ------
    ControlError, RobotError
        The robot cannot be controlled, or not follow the path.
    """

    robot: Robot
    gains: Gains
    path: TipPath | JointPath | None = None
    start_delay_s: float = 0.0
    adaptation: AdaptationSettings | None = None
    tip_speed_m_s: float = TIP_SPEED_M_S
    runaway: RunawayLimits = field(default_factory=RunawayLimits)
    following: FollowingLimits = field(default_factory=FollowingLimits)
    checks_beside: bool = False
    counts: Counts = field(default_factory=Counts)
    untold: Untold = field(default_factory=Untold)

    def __post_init__(self) -> None:
        self.law = ControlLaw(self.robot, self.gains, None, self.adaptation, self.tip_speed_m_s)
        self._stamps = StampWatch(self.law.dt_s)
        self._sensors = SensorCorrection(self.robot, self.law.plan.active)
        self._last: Answer | None = None
        self._adaptation_reset = False
        self._watch = AppliedWatch(np.array([v.rated_voltage_v for v in self.robot.valves]))
        self._runaway = RunawayWatch(self.robot, self.law.limits, self.runaway, self.law.dt_s)
        self._following = FollowingWatch(self.robot, self.following)
        self._bad = BadSampleWatch()
        own = None
        if self.path is not None:
            own = OwnPath(self.law.robot, self.path, self.start_delay_s, self.tip_speed_m_s)
        self.requests = MotionRequests(
            own, self.counts, lambda: self.silent or self._fault, checks_beside=self.checks_beside
        )
        warm_up(self.law)

    def answer(self, sample: Sample) -> Answer | None:
        """Answer a sample.

        Parameters
        ----------
        sample : Sample

        Returns
        -------
        Answer or None
            The same object again for the newest stamp, None for an older one and once `silent`.
        """
        if self.silent:
            return None
        last = self._last
        if last is not None and sample.stamp_ns < last.stamp_ns:
            self.counts.old += 1
            self._stamps.older((last.stamp_ns - sample.stamp_ns) / _SECOND_NS)
            return None
        if last is not None and self._is_again(sample.stamp_ns, last):
            self.counts.repeated += 1
            return last
        if self._adaptation_reset and self.law.adaptation is not None:
            self._adaptation_reset = False  # before: another may be asked for meanwhile
            self.law.adaptation.reset(used=False)
        if not self._watch.settled and self.law.adaptation is not None:
            self.law.adaptation.forget()  # nothing is learnt from commands without effect
        sample = self._sensors.corrected(sample)
        gauge = sample.gauge(self.robot)
        reference = self._reference(sample)
        if fault := self._fault:
            output = self.law.stopped(sample.q, reference, fault)
        else:
            output = self._driven(sample, gauge, reference)
            self._look_behind(sample.q, output)
        self._count(sample.stamp_ns, output)
        moving = any(reference.velocity.tolist())
        if self._run is not None:
            self._run.moved = self._run.moved or moving
        self._watch.commanded(sample.stamp_ns, output.voltage_v, moving=moving)
        self._last = Answer(sample.stamp_ns, output, reference)
        return self._last

    def _is_again(self, stamp_ns: int, last: Answer) -> bool:
        """Whether a stamp is the newest one, or of no later instant as far as seconds tell."""
        run = self._run
        return stamp_ns == last.stamp_ns or (run is not None and not run.is_later(stamp_ns))

    def _driven(
        self,
        sample: Sample,
        gauge: tuple[FloatArray, FloatArray, float, float],
        reference: Reference,
    ) -> Output:
        """The law's answer; its valves stay shut for a while after a sample that has none."""
        run, bad = self._run, self._bad
        now_s = 0.0 if run is None else run.now_s
        output = self.law.step(
            now_s, sample.q, *gauge, reference, self._ahead(), shut=bool(bad.shut)
        )
        # Before the first good sample nothing was driven, and nothing begins anew.
        if run is None:
            return output
        why = bad.judge(sample.stamp_ns, output.fault, anew=self.law.anew)
        return replace(output, fault=why) if why else output

    def _reference(self, sample: Sample) -> Reference:
        """The reference at a sample; one that is not finite starts nothing and is none seen."""
        run, finite = self._run, sample.is_finite
        if run is None:
            if not finite:
                still = np.zeros_like(sample.q)
                return Reference("joint", sample.q, still, still)
            # What a listed load or tilt asks of the cylinders counts for what they can hold.
            run = ReferenceRun.begin(self.law.robot, sample, self.tip_speed_m_s)
            self.requests.begin(run)
        run.advance(sample.stamp_ns)
        since_s = run.now_s
        if finite:
            since_s = run.see(sample.q)
            self._guard(run)
        if self._watch.withheld:
            # A bad sample that came just before is over soon; this may last.
            if run.follow(_WITHHELD, moved=self._watch.moved) or run.following != _WITHHELD:
                run.following = _WITHHELD
                self.requests.message = f"{_WITHHELD}: staying with the robot's pose"
        elif self._bad.shut:
            why = f"a sample could not be answered: {self._bad.found}"
            run.follow(why, moved=run.moved)
        elif run.following == _WITHHELD:
            self.requests.message = ""
            self.requests.resume(run, "the valves did not get the commands")
        elif run.following:
            self.requests.resume(run, run.following)
        elif self._stamps.is_gap(run.now_s - since_s):
            why = f"no usable sample came for {run.now_s - since_s:.3f} s"
            run.follow(why, moved=run.moved, since_s=since_s)
            self.requests.resume(run, why)
        return self.requests.reference(run)

    def _guard(self, run: ReferenceRun) -> None:
        """Judge the measured motion; what runs away is at 0 V until `restart`."""
        watch = self._runaway
        fault = watch.judge(run.now_s, run.q, driven=not self._watch.withheld)
        self.law.let_beyond(watch.lower, watch.upper)
        if fault:
            run.hold()
            run.anew = False

    def _ahead(self) -> Reference | None:
        """The reference at the instant that the law looks ahead to."""
        if self._run is None or self.law.lead_s == 0.0:
            return None
        return self._run.ahead(self.law.lead_s)

    def _look_behind(self, q: FloatArray, output: Output) -> None:
        """An arm that does not follow is held where it is, from the next sample on."""
        run, watch = self._run, self._following
        if run is None or output.fault:
            return
        if why := watch.judge(run.now_s, q, output.q_d, run.epoch, held=run.held):
            run.hold()
            run.anew = False
            if not watch.fault:
                self.counts.not_followed += 1
                self.requests.dropped(f"{why}: it runs against something, or lacks the force")

    def _count(self, stamp_ns: int, output: Output) -> None:
        if self._last is not None:
            apart_s = (stamp_ns - self._last.stamp_ns) / _SECOND_NS
            self._stamps.follows(apart_s)
            self.counts.missed += max(0, round(apart_s / self.law.dt_s) - 1)
        self.counts.answered += 1
        self.counts.faults += bool(output.fault)
        self.untold.add(output)

    def applied(self, stamp_ns: int, voltage_v: FloatArray) -> None:
        """What the valves got at a stamp; changes nothing as long as that was the command.

        Where the commands are withheld the reference stays with the robot. Once they are applied
        again it is held there; a path of which nothing was driven yet starts anew.

        Parameters
        ----------
        stamp_ns : int
        voltage_v : (m,) array
            In the robot's order.
        """
        self._watch.applied(stamp_ns, voltage_v)
        self.counts.withheld = self._watch.count

    def wind_down(self) -> FloatArray:
        """The next voltage on the way to 0 V within the slew limit."""
        return self.law.wind_down()

    def restart(self) -> None:
        """Forget everything: the next sample is the first."""
        self.law.reset()
        if self.law.adaptation is not None:
            self.law.adaptation.reset()
        self.requests.forget()
        self._last = None
        self.untold.take()
        self._adaptation_reset = False
        self._watch.clear()
        self._runaway.forget()
        self._following.forget()
        self._bad.forget()
        self._stamps.forget()

    def request_adaptation_reset(self) -> None:
        """Start the estimates anew at the next sample. May be called from another thread.

        What the law uses goes back to the model at its usual pace.

        Raises
        ------
        ControlError
            Nothing is adapted.
        """
        if self.law.adaptation is None:
            raise ControlError("adaptation is off, nothing to reset")
        self._adaptation_reset = True

    @property
    def base_frame(self) -> str:
        """Name of the frame that tip positions are in."""
        return self.robot.joints[0].parent_link

    @property
    def last(self) -> Answer | None:
        """The newest answer."""
        return self._last

    @property
    def silent(self) -> str:
        """Why no sample is answered any more, until `restart`; empty where they are."""
        return self._stamps.gone_back

    @property
    def message(self) -> str:
        """Why what was asked for last is not played; empty where it is."""
        return self.requests.message

    @property
    def path_waits(self) -> bool:
        """The path is to be checked from here: `requests.check_waiting_path`."""
        return self.requests.path_waits and not self.silent

    @property
    def moving(self) -> bool:
        """A path or trajectory is being played."""
        run = self._run
        return run is not None and run.moving and not self.silent

    @property
    def _run(self) -> ReferenceRun | None:
        """The reference; None before the first sample."""
        return self.requests.run

    @property
    def _fault(self) -> str:
        """Why the valves are at 0 V until `restart`; empty where they are not."""
        watches = self._following.fault or self._runaway.fault or self._bad.fault
        return watches or self._stamps.other_rate
