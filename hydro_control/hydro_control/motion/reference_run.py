"""What lives from the first sample after activation on: the reference, sample by sample.

What is asked of it beside the thread of the samples comes by `hydro_control.motion.asking`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from hydro_control.motion.reference import Plan, ReferencePlayer
from hydro_control.motion.required_motion import Reference
from hydro_control.state.sample import Sample
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.robot import FloatArray, Robot

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

    @property
    def overtaken(self) -> bool:
        """Something was stopped, set or begun anew since: what was asked for is not played."""
        run = self.run
        return run.over or run.stops != self.stops or run.epoch != self.epoch


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
    played : Asked or None
        What was played last of what was asked for.
    epoch : int
        Of where the reference stands: another one each time that it is set anew. What was
        planned in one is played in no other.
    caught : int
        The newest epoch that began with a hold where the robot stood.
    stop : bool
        To come to rest at the next sample.
    stops : int
        Stops asked for so far: what was asked for before one is not played after it.
    following : str
        Why commands have no effect, and the reference stays with the robot; empty where it does
        not.
    dropped : bool
        Something was played, or was to be, when that began.
    of_path : bool
        What was played last is the controller's own path, no trajectory, and was not stopped.
    path_waits : bool
        The controller's own path has to be checked from this pose first (`asking.ask_path`).
    moved : bool
        The reference has moved since the first sample.
    anew : bool
        It was the path, nothing of it had been driven yet, and no stop was asked for since: it
        may start anew.
    over : bool
        The controller has begun anew since: nothing is asked of this one any more.
    lost : bool
        A trajectory that had been accepted was not played with the newest sample, and no stop was
        the reason: the reference was set anew in the middle of it.
    """

    first_ns: int
    player: ReferencePlayer
    now_s: float
    q: FloatArray
    seen_s: float = 0.0
    pending: Asked | None = None
    played: Asked | None = None
    epoch: int = 0
    caught: int = 0
    stop: bool = False
    stops: int = 0
    following: str = ""
    dropped: bool = False
    of_path: bool = False
    path_waits: bool = False
    moved: bool = False
    anew: bool = False
    over: bool = False
    lost: bool = False

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

    @property
    def held(self) -> bool:
        """Nothing was played since the reference was set to where the robot stood."""
        return self.caught == self.epoch

    def advance(self, stamp_ns: int) -> None:
        """Time went on.

        Parameters
        ----------
        stamp_ns : int
            Of the newest sample.
        """
        self.now_s = self.since_first_s(stamp_ns)

    def since_first_s(self, stamp_ns: int) -> float:
        """Time of a stamp as `now_s` counts it, s.

        Parameters
        ----------
        stamp_ns : int
        """
        return (stamp_ns - self.first_ns) / _SECOND_NS

    def is_later(self, stamp_ns: int) -> bool:
        """Whether a stamp is of a later instant than `now_s`: not where seconds cannot tell.

        After a leap of weeks a nanosecond more is none.

        Parameters
        ----------
        stamp_ns : int
        """
        return self.since_first_s(stamp_ns) > self.now_s

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

    @property
    def standing(self) -> Standing:
        """Where the reference stands now."""
        return Standing(self, self.epoch, self.stops)

    def ask_stop(self) -> None:
        """Come to rest at the next sample, and play nothing that was asked for before."""
        self.stops += 1
        self.stop = True

    # The epoch comes last: who asks in between plans from what is going, and is overtaken by it.
    def _play(self, plan: Plan) -> None:
        self.player.play(plan, self.now_s if plan.start_s is None else plan.start_s)
        self.epoch += 1

    def hold(self) -> bool:
        """Stand where the robot is; what was asked for is dropped.

        Returns
        -------
        bool
            Something that was to be played from this sample on was dropped.
        """
        self.player.hold(self.q, self.now_s)
        self.epoch += 1
        self.caught = self.epoch
        # Only behind the epoch: what is handed over from now on is refused by whoever does it.
        waited = self.pending is not None
        # A stop stays to be taken up: it ends what would wait on, and set out anew later.
        self.pending, self.path_waits = None, False
        return waited

    def follow(self, why: str, *, moved: bool, since_s: float | None = None) -> bool:
        """Commands have no effect: stay with the robot, wherever it goes.

        Parameters
        ----------
        why : str
            They have none. Of several reasons at once the first is kept.
        moved : bool
            Something of what is played was driven.
        since_s : float, optional
            `now_s` from which on they have none; by default the present one.

        Returns
        -------
        bool
            They were applied until now.
        """
        if self.following:
            self.hold()
            return False
        self.following = why
        moving = self.player.moving(self.now_s if since_s is None else since_s)
        waits = self.path_waits
        self.anew = ((moving and self.of_path) or waits) and not moved
        self.dropped = self.hold() or moving or waits
        return True

    def reference(self) -> Reference:
        """The reference at the newest sample, once what was asked for has been taken up."""
        if self.stop:
            self.stop, self.path_waits, self.anew, self.of_path = False, False, False, False
            if self.moving:
                self.player.stop(self.now_s)
        if self.pending is not None:
            asked, self.pending = self.pending, None
            if self.is_playable(asked) and not self.moving:
                self.played = asked
                self._play(asked.plan)
                self.of_path, self.path_waits = asked.of_path, False
            else:
                self.lost = asked.stops == self.stops and not asked.of_path
        self.player.settle(self.q, self.now_s)
        return self.player.sample(self.now_s)

    def is_playable(self, asked: Asked) -> bool:
        """Whether nothing was stopped, or set anew, since a plan was asked for.

        Parameters
        ----------
        asked : Asked
        """
        stopped = asked.stops != self.stops or (asked.of_path and not self.path_waits)
        return asked.epoch == self.epoch and not stopped

    def ahead(self, lead_s: float) -> Reference:
        """The reference some time after the newest sample.

        Parameters
        ----------
        lead_s : float
        """
        return self.player.sample(self.now_s + lead_s)
