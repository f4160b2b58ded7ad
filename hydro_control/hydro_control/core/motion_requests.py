"""What is asked of the controller beside its samples: its own path, trajectories, stops.

Asked for is what another thread hands over to the reference (`hydro_control.motion.asking`);
refusals are counted here, and what became of what was asked for last is put into words.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

from hydro_control.core.answer import Counts
from hydro_control.errors import NUMERICAL_ERRORS, ControlError
from hydro_control.motion.asking import ask_path, ask_trajectory
from hydro_control.motion.path_limits import same_start, start_of_path
from hydro_control.motion.reference_run import ReferenceRun, Standing
from hydro_control.motion.required_motion import Reference
from hydro_control.motion.trajectory import Waypoint
from hydro_model.errors import RobotError, in_short
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.robot import FloatArray, Robot

_LOST = (
    "the trajectory was dropped: the reference was set anew in the middle of the sample that it"
    " was accepted in: ask again"
)


class OwnPath:
    """The path that a controller plays from the first sample on, as it was given.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    start_delay_s : float
        Hold before it.
    tip_speed_m_s : float
        It is refused beyond.

    Raises
    ------
    ControlError, RobotError
        It cannot be followed, whatever pose it starts in.
    """

    def __init__(
        self, robot: Robot, path: TipPath | JointPath, start_delay_s: float, tip_speed_m_s: float
    ) -> None:
        self._robot, self.path, self.start_delay_s = robot, path, start_delay_s
        self._checked_from = start_of_path(robot, path, tip_speed_m_s)

    def is_checked_from(self, q: FloatArray) -> bool:
        """Whether nothing more has to be checked where it begins at joint positions.

        Parameters
        ----------
        q : (n,) array
        """
        return same_start(self._robot, self.path, self._checked_from, q)


class MotionRequests:
    """Requests, and the reference that they are made of from the first sample on.

    `begin`, `resume`, `reference`, `dropped` and `forget` are the samples' side; everything else
    may be called from another thread.

    Parameters
    ----------
    own : OwnPath or None
    counts : Counts
        Refusals are counted there.
    stopped : callable
        Why the controller drives nothing any more; empty where it does.
    checks_beside : bool
        The own path waits until somebody has called `check_waiting_path`.

    Attributes
    ----------
    run : ReferenceRun or None
        None before the first sample.
    message : str
        Why what was asked for last is not played; empty where it is.
    """

    def __init__(
        self,
        own: OwnPath | None,
        counts: Counts,
        stopped: Callable[[], str],
        *,
        checks_beside: bool,
    ) -> None:
        self._own, self._counts, self._stopped = own, counts, stopped
        self._checks_beside = checks_beside
        self._stop_asked = False
        self.run: ReferenceRun | None = None
        self.message = ""

    def begin(self, run: ReferenceRun) -> ReferenceRun:
        """Have the own path played from the first sample on.

        Parameters
        ----------
        run : ReferenceRun
            At that sample.

        Returns
        -------
        ReferenceRun
            The same.
        """
        self._play_own(run)
        self.run = run
        if self._stop_asked:  # before this sample, or while it was at work
            run.ask_stop()
        return run

    def resume(self, run: ReferenceRun, why: str) -> None:
        """Commands have an effect again: hold here; who wants a motion asks for it anew.

        Parameters
        ----------
        run : ReferenceRun
        why : str
            They had none.
        """
        run.following = ""
        if run.anew:
            self._play_own(run)
        elif run.dropped:
            self.dropped(why)

    def reference(self, run: ReferenceRun) -> Reference:
        """The reference at the newest sample, with what was asked for until then.

        Parameters
        ----------
        run : ReferenceRun

        Returns
        -------
        Reference
        """
        reference = run.reference()
        if run.lost:
            run.lost = False
            self.message = _LOST
        return reference

    def dropped(self, why: str) -> None:
        """A motion was dropped.

        Parameters
        ----------
        why : str
        """
        self.message = f"holding: the motion was dropped, as {why}"

    def forget(self) -> None:
        """The next sample is the first: nothing is asked of the reference so far any more."""
        if self.run is not None:
            self.run.over = True
        self.run, self._stop_asked = None, False
        self.message = ""

    def _play_own(self, run: ReferenceRun) -> None:
        """Play the own path from where the robot stands, or have it checked from there first."""
        own = self._own
        if own is None:
            return
        checked = own.is_checked_from(run.q)
        if self._checks_beside and not checked:
            run.path_waits, self.message = True, ""
            return
        try:
            run.play_path(own.path, own.start_delay_s, checked=checked)
            self.message = ""
        except (ControlError, *NUMERICAL_ERRORS) as error:
            self._refuse_own(error)

    def _refuse_own(self, error: Exception) -> None:
        self._counts.refused += 1
        self.message = f"path refused, holding: {error}"

    @property
    def path_waits(self) -> bool:
        """`check_waiting_path` has something to do."""
        run = self.run
        return run is not None and run.path_waits and run.pending is None

    def check_waiting_path(self) -> None:
        """Check the own path from where the machine stands, and have it played if it can be.

        To be called from another thread than that of the samples, which holds meanwhile.
        """
        run, own = self.run, self._own
        if run is None or own is None:
            return
        try:
            ask_path(run, own.path, own.start_delay_s)
        except ControlError as error:
            if run is self.run:
                self._refuse_own(error)

    @property
    def standing(self) -> Standing | None:
        """Where the reference stands now; None before the first sample."""
        return None if self.run is None else self.run.standing

    def stop(self) -> None:
        """Come to rest at the next sample, and end what is being checked.

        Before the first sample: hold from there on, the own path is not played.
        """
        self._stop_asked = True  # before `run` is looked at: `begin` sets that first
        run = self.run
        if run is not None:
            run.ask_stop()

    def trajectory(
        self,
        space: Literal["tip", "joint"],
        names: Sequence[str],
        waypoints: Sequence[Waypoint],
        start_ns: int = 0,
        standing: Standing | None = None,
    ) -> None:
        """Play a trajectory from the next sample on.

        Parameters
        ----------
        space : {"tip", "joint"}
        names : sequence of str
        waypoints : sequence of Waypoint
            Empty: come to rest.
        start_ns : int
            Stamp to start at, up to `asking.MOST_AHEAD_S` ahead; 0 for now.
        standing : Standing, optional
            `standing` when it was asked for; by default now. What was stopped, or set the
            reference anew, between then and the end of its check is not followed by it.

        Raises
        ------
        ControlError
            It is refused: why.
        """
        if not waypoints:
            self.stop()
            return
        run = self.run
        if run is None:
            raise self.refusal("no sample has come yet")
        standing = run.standing if standing is None else standing
        if stopped := self._stopped():
            raise self.refusal(f"the controller stopped: {stopped}")
        said = self.message
        try:
            ask_trajectory(standing, space, names, waypoints, start_ns)
        except (ControlError, RobotError) as error:
            raise self.refusal(str(error)) from error
        # Whatever was overlooked above, memory included: the arm is held on, only this request is
        # not played.
        except Exception as error:
            raise self.refusal(f"it cannot be computed: {in_short(error)}") from error
        # What was said since is of it: a sample may have dropped it already.
        if self.message == said:
            self.message = ""

    def refusal(self, why: str) -> ControlError:
        """Count a trajectory that is not played, and say so until the next one is.

        Parameters
        ----------
        why : str

        Returns
        -------
        ControlError
            To be raised by whoever was asked for it.
        """
        self._counts.refused += 1
        self.message = f"trajectory refused: {why}"
        return ControlError(self.message)
