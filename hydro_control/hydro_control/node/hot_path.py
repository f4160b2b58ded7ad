"""The 500 Hz thread of the controller node: sensor messages in, valve command out."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState

from hydro_control.core import winding_down
from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.core.sample_join import SampleJoin
from hydro_control.errors import ControlError
from hydro_model.robot import FloatArray
from hydro_msgs_docs import topics
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED
from hydro_msgs_docs.hot_loop import HotWait
from hydro_msgs_docs.hot_messages import HotMessage, HotVectors
from hydro_msgs_docs.loop_times import LoopTimes
from hydro_msgs_docs.messages import by_name
from hydro_msgs_docs.real_time import RealTime

#: Longest sleep without a message, after which the loop looks whether it should end.
_IDLE_S = 0.1
#: How long pressures wait for the joint positions of their stamp.
_PARTNER_S = 0.02
#: How long the loop has to end: the way to 0 V, acknowledged, takes a second at most, and
#: whoever asked for a transition waits for ten.
JOIN_S = 5.0


class HotPath:
    """Subscriptions, publishers and thread of the hot path.

    Parameters
    ----------
    node : rclpy.node.Node
    core : ControllerCore
    required_recorders : int
        Subscribers to wait for before the first answer: this many on the reference topics,
        and one more, the bridge, on `/valve_command`.
    real_time : RealTime
        Prepared before `start`.
    on_error : callable
        Told of the exception that ended the thread, from that thread, after the last 0 V; and,
        from that of `stop`, of a thread that does not end.
    """

    def __init__(
        self,
        node: Any,
        core: ControllerCore,
        required_recorders: int,
        real_time: RealTime,
        on_error: Callable[[BaseException], None],
    ) -> None:
        self._node, self._core, self._on_error = node, core, on_error
        self._real_time = real_time
        qos = topics.reliable()
        self._joints = HotVectors(node, topics.JOINT_STATES, qos)
        self._pressures = HotVectors(node, topics.CHAMBER_PRESSURES, qos)
        self._applied = HotVectors(node, topics.VALVE_STATE, qos)
        self._wait = HotWait(node, self._pressures)
        self._partner = HotWait(node, self._joints)
        self._join = SampleJoin(core.robot)
        self._valve_names = core.robot.valve_names
        self._command = self._publisher(JointState, topics.VALVE_COMMAND)
        self._joint_reference = self._publisher(JointState, topics.JOINT_REFERENCE)
        self._tip_reference = self._publisher(PointStamped, topics.TIP_REFERENCE)
        self._required = {
            self._command: required_recorders + 1,
            self._joint_reference: required_recorders,
            self._tip_reference: required_recorders,
        }
        self._messages = _Messages(core)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._held: threading.Thread | None = None
        self._matched = False
        self._driven = False
        self._answered_s: float | None = None
        #: Lateness of samples, and time from wake-up to command.
        self.times = LoopTimes(1.0 / core.robot.sensors.rate_hz)

    def _publisher(self, message_type: Any, topic: str) -> Any:
        options = QoSOverridingOptions.with_default_policies()
        return self._node.create_publisher(
            message_type, topic, topics.reliable(), qos_overriding_options=options
        )

    def destroy(self) -> None:
        """Give subscriptions and publishers back, after `stop`; a loop that is held keeps them.

        When it wakes it still sends its 0 V; the node's end takes them back.
        """
        if self._held is not None and self._held.is_alive():
            return
        for wait in (self._wait, self._partner):
            wait.destroy()
        for hot in (self._joints, self._pressures, self._applied):
            self._node.destroy_subscription(hot.subscription)
        for publisher in self._required:
            self._node.destroy_publisher(publisher)

    def start(self) -> None:
        """Answer samples from the next one on.

        Raises
        ------
        ControlError
            The thread of before has not ended yet.
        """
        if self._held is not None and self._held.is_alive():
            raise ControlError("expected the control loop of before to have ended, found it held")
        self._core.restart()
        self._join.clear()
        for hot in (self._joints, self._pressures, self._applied):
            hot.take_newest()
            hot.forget()
        self._matched = self._driven = False
        self._answered_s = None
        self.times = LoopTimes(1.0 / self._core.robot.sensors.rate_hz)
        self._stop.clear()
        # One that is held does not hold the process.
        thread = threading.Thread(target=self._main, name="hot_path", daemon=True)
        thread.start()  # where the system has none to give, there is none to be ended either
        self._thread = thread

    def stop(self) -> None:
        """End the thread; the last command is 0 V. One that does not end is told as an error."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._stop.set()
        self._wait.wake()
        thread.join(JOIN_S)
        if thread.is_alive():
            self._held = thread
            expected = f"expected the control loop to end within {JOIN_S:g} s"
            self._on_error(ControlError(f"{expected}, found it held in one of its steps"))

    @property
    def state(self) -> str:
        """What it is doing, in words."""
        if not self._matched:
            return f"{topics.WAITING}the bridge" + (
                " and the recorders" if self._required[self._joint_reference] else ""
            )
        if self._core.last is None:
            return f"{topics.WAITING}sensors"
        if self._core.path_waits:
            return "holding while the path is checked from here"
        return "following" if self._core.moving else "holding"

    @property
    def unanswered_s(self) -> float:
        """How long ago the newest sample was answered, s; 0 before the first one."""
        answered_s = self._answered_s
        return 0.0 if answered_s is None else time.monotonic() - answered_s

    @property
    def malformed(self) -> tuple[int, str]:
        """Number of unreadable messages and of those without a needed name; the newest's fault."""
        hot = (self._joints, self._pressures, self._applied)
        count = self._join.malformed + sum(one.unreadable for one in hot)
        said = (self._join.message, *(one.message for one in hot))
        return count, next(filter(None, said), "")

    def _main(self) -> None:
        failure: BaseException | None = None
        try:
            self._real_time.enter()
            while not self._stop.is_set():
                if self._wait.wait(_IDLE_S):
                    self._tick()
                self._real_time.idle()
        # Whatever went wrong, the valves go to zero first and the node is told after.
        except Exception as error:  # noqa: BLE001
            failure = error
        try:
            self._to_zero()
        except Exception as error:  # noqa: BLE001
            failure = failure or error
        if failure is not None:
            self._on_error(failure)

    def _tick(self) -> None:
        begin_ns = time.monotonic_ns()
        sample = self._sample()
        if sample is None or not self._all_matched():
            return
        self._take_applied()
        answer = self._core.answer(sample)
        if answer is None:
            return
        self._driven = True
        self._answered_s = 1e-9 * begin_ns
        self._publish_command(answer.stamp_ns, answer.output.voltage_v)
        self.times.work.add(time.monotonic_ns() - begin_ns)
        self._joint_reference.publish(self._messages.joint_reference(answer))
        self._tip_reference.publish(self._messages.tip_reference(answer))

    def _sample(self) -> Sample | None:
        """Take all that waits on both topics, and wait a little for a missing partner."""
        self._take()
        end = time.monotonic() + _PARTNER_S
        while self._join.waiting and (left := end - time.monotonic()) > 0.0:
            self._partner.wait(left)
            self._take()
        return self._join.newest()

    def _take(self) -> None:
        while (vector := self._joints.take()) is not None:
            self._join.add_joints(vector)
        while (vector := self._pressures.take()) is not None:
            self.times.took(vector.stamp_ns, time.monotonic_ns())
            self._join.add_pressures(vector)

    def _take_applied(self) -> None:
        while (vector := self._applied.take()) is not None:
            voltage_v = by_name(vector, "effort", self._valve_names)
            if voltage_v is not None:
                self._core.applied(vector.stamp_ns, np.array(voltage_v))

    def _all_matched(self) -> bool:
        if not self._matched:
            self._matched = all(
                publisher.get_subscription_count() >= count
                for publisher, count in self._required.items()
            )
        return self._matched

    def _to_zero(self) -> None:
        """Ramp to 0 V on the samples that still come; without them go there at once.

        0 V for the stamp that was answered last tells the bridge that no more will come: what
        merely falls silent trips it.
        """
        last = self._core.last
        if not self._driven or last is None:
            return
        down = winding_down.WindingDown(last.stamp_ns, time.monotonic())
        try:
            # Only time tells that no sample comes: the wake of a `stop` that fell into the last
            # cycle is still to be taken, and ends the first wait at once.
            while (left_s := down.left_s(time.monotonic())) > 0.0:
                self._wait.wait(left_s)
                sample = self._sample()
                if sample is None or not down.takes(sample.stamp_ns, time.monotonic()):
                    continue
                voltage_v = self._core.wind_down()
                self._publish_command(down.stamp_ns, voltage_v)
                down.answered(zero=not np.any(voltage_v))
        finally:
            # Whatever went wrong on the way down.
            self._publish_command(down.stamp_ns, np.zeros_like(last.output.voltage_v))
            self._command.wait_for_all_acked(Duration(seconds=winding_down.RAMP_S))

    def _publish_command(self, stamp: int, voltage_v: FloatArray) -> None:
        self._command.publish(self._messages.command(stamp, voltage_v))


class _Messages:
    """The three messages of a cycle, as bytes."""

    def __init__(self, core: ControllerCore) -> None:
        robot, lists = core.robot, ("position", "velocity", "effort")
        sizes = dict.fromkeys(lists, robot.dof)
        self._command = HotMessage(
            JOINT_STATE, {"effort": len(robot.valves)}, names=robot.valve_names
        )
        self._joint = HotMessage(JOINT_STATE, sizes, names=robot.joint_names)
        self._tip = HotMessage(POINT_STAMPED, {"point": 3}, frame_id=core.base_frame)

    def command(self, stamp: int, voltage_v: FloatArray) -> bytes:
        """What the valves shall get."""
        return self._command.filled(stamp, voltage_v.tolist())

    def joint_reference(self, answer: Answer) -> bytes:
        """What the joints shall do, and the force required for it."""
        out = answer.output
        lists = (out.q_d.tolist(), out.qd_d.tolist(), out.required_force_n.tolist())
        return self._joint.filled(answer.stamp_ns, *lists)

    def tip_reference(self, answer: Answer) -> bytes:
        """Where the tip shall be."""
        return self._tip.filled(answer.stamp_ns, answer.output.tip_d_m.tolist())
