"""The node class of the controller: parameters, services, trajectories, diagnostics."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from hydro_control.core.core import ControllerCore
from hydro_control.errors import ControlError
from hydro_control.law.gain_checks import gain_warnings
from hydro_control.node import parameters
from hydro_control.node.hot_path import HotPath
from hydro_control.node.trajectory_intake import TrajectoryIntake
from hydro_model.motion.paths import load_path
from hydro_model.robot_files import load_robot
from hydro_msgs_docs import topics
from hydro_msgs_docs.aside import log_of
from hydro_msgs_docs.node_parameters import declare
from hydro_msgs_docs.nodes import (
    ERROR,
    OK,
    WARN,
    Diagnostics,
    fix_parameters,
    logged_transition,
    refuse_closed_transitions,
)
from hydro_msgs_docs.real_time import RealTime, RealTimeOptions, as_others

_DIAGNOSTICS_S = 1.0
_LOOK_S = 0.1
#: Without a sample for so long the controller says so. A simulated machine in lockstep that waits
#: for an answer says its cycle again each second, and is not lost.
_UNANSWERED_S = 1.5


class ControllerNode(LifecycleNode):
    """Lifecycle node `controller`.

    Raises
    ------
    ParameterError, ControlError, RobotError, RealTimeError
        At construction: a parameter, the robot file or the path file cannot be used.
    """

    def __init__(self) -> None:
        super().__init__("controller")
        declare(self, parameters.PARAMETERS)
        self.failure: BaseException | None = None
        self._hot: HotPath | None = None
        self._log = log_of(self)
        self._real_time = RealTime(RealTimeOptions(), self._log.warn)
        self._active = False
        self._core = self._make_core()
        self._diagnostics = Diagnostics(self, self._core.robot.name)
        self._said = self._odd_gains = ""
        self._said_s = 0.0
        self._trajectories: list[Any] = []
        self._path_check: threading.Thread | None = None
        refuse_closed_transitions(self)
        fix_parameters(self, lambda: self._hot is not None)
        # Of a clock that never steps: what is wrong is said whatever the ROS clock does.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(_LOOK_S, self._look, clock=steady)
        self.create_service(Trigger, "~/reset_adaptation", self._reset_adaptation)

    def _make_core(self) -> ControllerCore:
        settings = parameters.read(self)
        path = load_path(settings.path) if settings.path else None
        robot = load_robot(settings.robot)
        return ControllerCore(
            robot,
            settings.gains,
            path,
            settings.start_delay_s,
            settings.adaptation,
            settings.tip_speed_limit_m_s,
            settings.runaway,
            settings.following,
            checks_beside=True,
        )

    def _configure(self) -> None:
        settings = parameters.read(self)
        self._core = self._make_core()
        self._odd_gains = "; ".join(gain_warnings(self._core.robot, self._core.gains))
        if self._odd_gains:
            self._log.warn(self._odd_gains)
        self._real_time = RealTime(settings.real_time, self._log.warn)
        self._hot = HotPath(
            self, self._core, settings.required_recorders, self._real_time, self._failed
        )
        options = QoSOverridingOptions.with_default_policies()
        core = self._core
        intake = TrajectoryIntake(core, lambda: self._active and self._core is core, self._log)
        for message_type, topic, callback in (
            (JointTrajectory, topics.JOINT_TRAJECTORY, partial(intake.take, "joint")),
            (MultiDOFJointTrajectory, topics.TIP_TRAJECTORY, partial(intake.take, "tip")),
        ):
            self._trajectories.append(
                self.create_subscription(
                    message_type,
                    topic,
                    callback,
                    topics.reliable(),
                    qos_overriding_options=options,
                )
            )

    def _activate(self) -> None:
        if self._hot is None:
            raise ControlError("the controller is not configured")
        self._real_time.prepare()
        try:
            self._hot.start()
        except BaseException:
            self._real_time.leave()
            raise
        self._active = True

    def _deactivate(self) -> None:
        self.stop_driving()

    def _cleanup(self) -> None:
        self.stop_driving()
        if self._hot is not None:
            self._hot.destroy()
            self._hot = None
        while self._trajectories:
            self.destroy_subscription(self._trajectories.pop())

    on_configure = logged_transition(_configure)
    on_activate = logged_transition(_activate)
    on_deactivate = logged_transition(_deactivate)
    on_cleanup = logged_transition(_cleanup)
    on_shutdown = logged_transition(_cleanup)
    on_error = logged_transition(_cleanup)

    def stop_driving(self) -> None:
        """End at 0 V, and with it what is being checked."""
        self._active = False
        self._core.requests.stop()
        if self._hot is not None:
            self._hot.stop()
            self._real_time.leave()

    def close(self) -> None:
        """Give everything back, valves at 0 V first."""
        self._cleanup()
        self._log.close()
        self.destroy_node()

    def _failed(self, error: BaseException) -> None:
        self.failure = self.failure or error  # what comes later may follow from it

    def _reset_adaptation(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            self._core.request_adaptation_reset()
        except ControlError as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, "the estimates start anew"
        return response

    def _look(self) -> None:
        """Check what waits for it; publish `/diagnostics` each second and when they change."""
        self._check_waiting_path()
        level, message = self._status()
        now = time.monotonic()
        if message != self._said and level != OK:
            self._log.warn(message)
        if message != self._said or now - self._said_s >= _DIAGNOSTICS_S:
            self._said, self._said_s = message, now
            self._diagnostics.publish(level, message, self._values())

    def _check_waiting_path(self) -> None:
        """In a thread of its own: a long path takes seconds, and stops are heard meanwhile."""
        busy = self._path_check is not None and self._path_check.is_alive()
        if self._active and self._core.path_waits and not busy:
            self._path_check = threading.Thread(
                target=self._check_path, name="path_check", daemon=True
            )
            self._path_check.start()

    def _check_path(self) -> None:
        as_others()
        self._core.requests.check_waiting_path()

    def _status(self) -> tuple[bytes, str]:
        """What is to be said: of faults and notes those since the last look, too."""
        if not self._active or self._hot is None:
            return OK, topics.IDLE[0] if self._hot is not None else topics.IDLE[1]
        if self._core.silent:
            return ERROR, self._core.silent
        if self._hot.unanswered_s > _UNANSWERED_S:
            # One text as long as it lasts; how long that is stands in the values.
            silence = f"{topics.WAITING}samples: none for more than {_UNANSWERED_S:g} s"
            return ERROR, "; ".join(filter(None, (silence, self._core.message)))
        fault, notes = self._core.untold.take()
        if (last := self._core.last) is not None:
            fault, notes = last.output.fault or fault, last.output.notes or notes
        _, lacking = self._hot.malformed
        if fault:
            return ERROR, f"0 V: {fault}"
        if lacking:
            return ERROR, lacking
        if self._core.message:
            return WARN, self._core.message
        if notes:
            return WARN, f"{self._hot.state}; {'; '.join(notes)}"
        if self._odd_gains:
            return WARN, f"{self._hot.state}; {self._odd_gains}"
        return OK, self._hot.state

    def _values(self) -> dict[str, object]:
        counts = self._core.counts
        values: dict[str, object] = {
            "robot": self._core.robot.name,
            "robot_file": self._core.robot.source,
            "answered": counts.answered,
            "repeated": counts.repeated,
            "missed_stamps": counts.missed,
            "old_stamps": counts.old,
            "faults": counts.faults,
            "refused": counts.refused,
            "withheld": counts.withheld,
            "not_followed": counts.not_followed,
        }
        listed = self._core.law.plan
        values["compensated"] = " ".join(listed.names)
        values["not_compensated"] = " ".join(listed.left_out)
        adaptation = self._core.law.adaptation
        values |= {"adaptation": "off"} if adaptation is None else adaptation.report()
        if self._hot is not None:
            values["malformed"] = self._hot.malformed[0]
            values["sample_age_s"] = f"{self._hot.unanswered_s:.1f}"
            values |= self._hot.times.values() | self._real_time.values()
        return values
