"""What lives from the first sample after activation on: the reference, and what is asked of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from hydro_control.errors import ControlError
from hydro_control.reference import Plan, ReferencePlayer
from hydro_control.required_motion import Reference
from hydro_control.sample import Sample
from hydro_control.trajectory import Waypoint
from hydro_model.errors import HydroError, in_short
from hydro_model.paths import JointPath, TipPath
from hydro_model.robot import FloatArray, Robot

#: A trajectory may ask to begin this long after the newest sample, s: long enough for several
#: machines to begin together. More is a stamp of another clock, or of one that was put forward:
#: the arm would begin by itself when everybody has forgotten.
MOST_AHEAD_S = 10.0
#: Longest trajectory, and its most points: no other is heard while it is checked.
LONGEST_S, MOST_POINTS = 600.0, 5000

_SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Asked:
    """A plan that waits for the next sample.

    Attributes
    ----------
    plan : Plan
    epoch : int
        In which it was planned.
    stops : int
        How many stops had been asked for before it.
    of_path : bool
        It is the controller's own path.
    """

    plan: Plan
    epoch: int
    stops: int
    of_path: bool = False


class Standing(NamedTuple):
    """Where the reference stands at an instant: what is asked for then is played from there alone.

    Attributes
    ----------
    run : ReferenceRun
    epoch, stops : int
        Of it, at that instant.
    """

    run: ReferenceRun
    epoch: int
    stops: int


@dataclass(slots=True)
class ReferenceRun:
    """The reference sample by sample, its time counted from the first.

    What another thread asks for waits for the next sample.

    Attributes
    ----------
    first_ns : int
        Stamp of the first sample.
    player : ReferencePlayer
    now_s : float
        Of the newest sample, from the first on.
    q : (n,) array
        Joint positions of the newest sample in which they were finite.
    seen_s : float
        Of that sample.
    pending : Asked or None
        To be played from the next sample on.
    epoch : int
        Of where the reference stands: another one each time that it is set anew. What was
        planned in one is played in no other.
    stop : bool
        To come to rest at the next sample.
    stops : int
        Stops asked for so far: what was asked for before one is not played after it.
    following : bool
        Commands are withheld: the reference stays with the robot.
    dropped : bool
        Something was played, or was to be, when that began.
    of_path : bool
        What was played last is the controller's own path, and no trajectory.
    path_waits : bool
        The controller's own path has to be checked from this pose first (`ask_path`).
    moved : bool
        The reference has moved since the first sample.
    anew : bool
        It was the path, and nothing of it had been driven yet: it may start anew.
    """

    first_ns: int
    player: ReferencePlayer
    now_s: float
    q: FloatArray
    seen_s: float = 0.0
    pending: Asked | None = None
    epoch: int = 0
    stop: bool = False
    stops: int = 0
    following: bool = False
    dropped: bool = False
    of_path: bool = False
    path_waits: bool = False
    moved: bool = False
    anew: bool = False

    @classmethod
    def begin(cls, robot: Robot, sample: Sample, tip_speed_m_s: float) -> ReferenceRun:
        """Capture the pose of the first sample.

        Parameters
        ----------
        robot : Robot
        sample : Sample
        tip_speed_m_s : float
            Paths on which the tip is faster are refused.
        """
        player = ReferencePlayer(robot, sample.q, tip_speed_m_s)
        return cls(sample.stamp_ns, player, 0.0, sample.q)

    @property
    def moving(self) -> bool:
        """A path or trajectory is being played."""
        return self.player.moving(self.now_s)

    def advance(self, stamp_ns: int) -> None:
        """Time went on.

        Parameters
        ----------
        stamp_ns : int
            Of the newest sample.
        """
        self.now_s = self._since_first_s(stamp_ns)

    def _since_first_s(self, stamp_ns: int) -> float:
        return (stamp_ns - self.first_ns) / _SECOND_NS

    def is_later(self, stamp_ns: int) -> bool:
        """Whether a stamp is of a later instant than `now_s`: not where seconds cannot tell.

        After a leap of weeks a nanosecond more is none.

        Parameters
        ----------
        stamp_ns : int
        """
        return self._since_first_s(stamp_ns) > self.now_s

    def see(self, q: FloatArray) -> float:
        """Take the pose of the newest sample.

        Parameters
        ----------
        q : (n,) array
            Joint positions, finite.

        Returns
        -------
        float
            `now_s` of the sample before it in which they were finite.
        """
        before_s, self.seen_s, self.q = self.seen_s, self.now_s, q
        return before_s

    def play_path(self, path: TipPath | JointPath, delay_s: float, *, checked: bool) -> None:
        """Play the controller's own path from now on.

        Parameters
        ----------
        path : TipPath or JointPath
        delay_s : float
            Hold before it.
        checked : bool
            It has been checked from this pose.

        Raises
        ------
        ControlError
            It is refused: why.
        """
        plan = self.player.plan_path(path, self.now_s, self.q, delay_s, path_checked=checked)
        self._play(plan)
        self.of_path = True

    def ask_path(self, path: TipPath | JointPath, delay_s: float) -> None:
        """Check the path that waits, and have it played from the next sample on.

        Called beside the thread of the samples: that takes up to seconds. Where the reference was
        set anew meanwhile nothing happens, and the path may still wait.

        Parameters
        ----------
        path : TipPath or JointPath
        delay_s : float
            Hold before it.

        Raises
        ------
        ControlError
            It is refused from where the reference stands still: why.
        """
        epoch, stops = self.epoch, self.stops
        if not self.path_waits or self.pending is not None:
            return
        try:
            plan = self.player.plan_path(path, self.now_s, self.q, delay_s)
        # Whatever it is, the arm is held on: a path that waits on would be checked for ever.
        except Exception as error:
            if self.epoch != epoch:
                return
            self.path_waits = False
            raise ControlError(_why(error)) from error
        if self.path_waits and self.epoch == epoch:
            self.pending = Asked(plan, epoch, stops, of_path=True)

    def ask(
        self,
        space: Literal["tip", "joint"],
        names: Sequence[str],
        waypoints: Sequence[Waypoint],
        start_ns: int,
        standing: Standing,
    ) -> None:
        """Have a trajectory played from the next sample on.

        Parameters
        ----------
        space : {"tip", "joint"}
        names : sequence of str
        waypoints : sequence of Waypoint
        start_ns : int
            Stamp to start at, up to `MOST_AHEAD_S` after the newest sample's; 0 for now. An
            approach to the first point ends there.
        standing : Standing
            When it was asked for, which may be before its turn to be checked came.

        Raises
        ------
        ControlError, RobotError
            It is refused: why.
        """
        if self.following:
            raise ControlError("the valves do not get the commands")
        if self.path_waits:
            raise ControlError(
                "the controller's own path is being checked: wait, or stop it with an empty"
                " trajectory (send_path --stop)"
            )
        waiting = self.pending
        if waiting is not None and self._is_playable(waiting):
            raise ControlError(
                "another motion was accepted and begins with the next sample: wait, or stop it"
                " with an empty trajectory (send_path --stop)"
            )
        start_s = self._since_first_s(start_ns) if start_ns else None
        wait_s = 0.0 if start_s is None else start_s - self.now_s
        if len(waypoints) > MOST_POINTS or waypoints[-1].time_s > LONGEST_S:
            raise ControlError(
                f"expected at most {MOST_POINTS} points over {LONGEST_S:g} s, found"
                f" {len(waypoints)} over {waypoints[-1].time_s:g} s: send it in parts, or give it"
                " as the controller's path"
            )
        if wait_s < 0.0:
            raise ControlError(f"it should start now or later, found {-wait_s:.3f} s ago")
        if wait_s > MOST_AHEAD_S:
            raise ControlError(
                f"it should start within {MOST_AHEAD_S:g} s of the newest sample, found"
                f" {wait_s:.3f} s ahead: give the time of a sample's stamp, or 0 for now"
            )
        plan = self.player.plan_trajectory(space, names, waypoints, self.now_s, self.q, start_s)
        if plan.start_s is not None and plan.start_s < self.now_s:
            raise ControlError(
                f"it should have begun {self.now_s - plan.start_s:.3f} s ago, as it took so long"
                " to check it: ask for it earlier"
            )
        self.pending = Asked(plan, standing.epoch, standing.stops)
        # Looked at after it was handed over: what comes later finds it, and drops it.
        if self.stops != standing.stops:
            raise ControlError("a stop was asked for while it was checked")
        if self.epoch != standing.epoch:
            raise ControlError("the reference was set anew while it was checked: ask again")

    @property
    def standing(self) -> Standing:
        """Where the reference stands now."""
        return Standing(self, self.epoch, self.stops)

    def ask_stop(self) -> None:
        """Come to rest at the next sample, and play nothing that was asked for before."""
        self.stops += 1
        self.stop = True

    def _play(self, plan: Plan) -> None:
        self.epoch += 1
        self.player.play(plan, self.now_s if plan.start_s is None else plan.start_s)

    def hold(self) -> None:
        """Stand where the robot is; what was asked for is dropped."""
        self.epoch += 1
        self.player.hold(self.q, self.now_s)
        self.stop, self.pending, self.path_waits = False, None, False

    def follow(self, *, moved: bool, since_s: float | None = None) -> bool:
        """Commands have no effect: stay with the robot, wherever it goes.

        Parameters
        ----------
        moved : bool
            Something of what is played was driven.
        since_s : float, optional
            `now_s` from which on they have none; by default the present one.

        Returns
        -------
        bool
            They were applied until now.
        """
        begins = not self.following
        if begins:
            self.following = True
            moving = self.player.moving(self.now_s if since_s is None else since_s)
            self.dropped = moving or self.pending is not None or self.path_waits
            self.anew = ((moving and self.of_path) or self.path_waits) and not moved
        self.hold()
        return begins

    def reference(self) -> Reference:
        """The reference at the newest sample, once what was asked for has been taken up."""
        if self.stop:
            self.stop, self.path_waits = False, False
            if self.moving:
                self.player.stop(self.now_s)
        if self.pending is not None:
            asked, self.pending = self.pending, None
            if self._is_playable(asked) and not self.moving:
                self._play(asked.plan)
                self.of_path, self.path_waits = asked.of_path, False
        self.player.settle(self.q, self.now_s)
        return self.player.sample(self.now_s)

    def _is_playable(self, asked: Asked) -> bool:
        """Whether nothing was stopped, or set anew, since a plan was asked for."""
        stopped = asked.stops != self.stops or (asked.of_path and not self.path_waits)
        return asked.epoch == self.epoch and not stopped

    def ahead(self, lead_s: float) -> Reference:
        """The reference some time after the newest sample.

        Parameters
        ----------
        lead_s : float
        """
        return self.player.sample(self.now_s + lead_s)


def _why(error: Exception) -> str:
    """What was raised on purpose in its own words, anything else in short."""
    return str(error) if isinstance(error, HydroError) else in_short(error)
