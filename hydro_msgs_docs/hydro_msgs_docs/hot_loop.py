"""A wait set around one or a few subscriptions, for the 500 Hz path.

rclpy's default executor costs about a quarter of a core at 500 Hz with two topics; a wait set
that wakes on the trigger subscription alone, with direct takes of the others, costs a tenth of
that. Subscriptions made here are left alone by the node's executor, which goes on serving
parameters and services in another thread.
"""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions


class _NeverExecuted(CallbackGroup):
    """Keeps its entities out of every executor: they are taken by hand."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        return None


class HotSubscription:
    """A subscription whose messages are taken by hand.

    Parameters
    ----------
    node : Node
    message_type : type
    topic : str
    qos : QoSProfile
    raw : bool
        Take serialised bytes instead of messages.
    """

    def __init__(
        self, node: Node, message_type: Any, topic: str, qos: QoSProfile, *, raw: bool = False
    ) -> None:
        self.topic = topic
        self.subscription: Any = node.create_subscription(
            message_type,
            topic,
            _unused,
            qos,
            callback_group=_NeverExecuted(),
            raw=raw,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def take(self) -> Any | None:
        """The next waiting message (bytes where raw), or None."""
        taken = self.take_numbered()
        return None if taken is None else taken[0]

    def take_numbered(self) -> tuple[Any, int | None] | None:
        """The next waiting message and its number, or None.

        A publisher counts its messages; the number is None where the middleware does not tell.
        """
        subscription = self.subscription
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        return None if taken is None else (taken[0], taken[1]["publication_sequence_number"])

    def take_newest(self) -> Any | None:
        """The newest waiting message, or None; older ones are dropped."""
        newest = None
        while (message := self.take()) is not None:
            newest = message
        return newest


def _unused(_message: Any) -> None:
    raise AssertionError("a hot subscription has no callback")


class HotWait:
    """Wait for any of some subscriptions, or for `wake`.

    Parameters
    ----------
    node : Node
    subscriptions : HotSubscription
        Those that wake the loop.
    """

    def __init__(self, node: Node, *subscriptions: HotSubscription) -> None:
        self._node, self._subscriptions = node, subscriptions
        self._guard = node.create_guard_condition(_noop, callback_group=_NeverExecuted())
        context = node.context.handle
        self._wait_set = rclpy_implementation.WaitSet(len(subscriptions), 1, 0, 0, 0, 0, context)

    def destroy(self) -> None:
        """Give what wakes it back; nobody may wait any more."""
        self._node.destroy_guard_condition(self._guard)

    def wake(self) -> None:
        """End a `wait` from another thread."""
        self._guard.trigger()

    def wait(self, timeout_s: float) -> bool:
        """Wait until a message is there; False on timeout or `wake`.

        Parameters
        ----------
        timeout_s : float

        Returns
        -------
        bool
        """
        wait_set = self._wait_set
        wait_set.clear_entities()
        for hot in self._subscriptions:
            wait_set.add_subscription(hot.subscription.handle)
        wait_set.add_guard_condition(self._guard.handle)
        wait_set.wait(int(timeout_s * 1e9))
        return bool(wait_set.get_ready_entities("subscription"))


def _noop() -> None:
    return None
