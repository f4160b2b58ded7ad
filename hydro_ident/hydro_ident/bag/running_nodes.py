"""What nodes that run beside a recording say of themselves: parameters, for its metadata."""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import yaml

from hydro_ident.bag.provenance import text_of
from hydro_ident.errors import BagError
from hydro_model.command_line.command import warn

#: Nodes that are asked, and the keys of the metadata that their parameters stand under.
ASKED = {"controller": "controller_parameters", "can_bridge": "bridge_parameters"}
#: Nodes are looked for so long, so often, and have so long to answer.
_LOOKED_FOR_S, _LOOK_S, _ANSWERED_S = 10.0, 0.1, 2.0


class RunningNodes:
    """Asks controller and bridge for their parameters while it is recorded.

    Discovery takes up to seconds, which no recording waits for: a thread asks, and what it has
    learnt is fetched by whoever writes.

    Parameters
    ----------
    attached : collection of str
        Keys of the metadata that need no asking.
    """

    def __init__(self, attached: Collection[str]) -> None:
        self._attached = frozenset(attached)
        self._answers: SimpleQueue[dict[str, str]] = SimpleQueue()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._ask, daemon=True)
        self._thread.start()

    def learnt(self) -> dict[str, str]:
        """What has come since it was last asked, by key of the metadata.

        Returns
        -------
        dict of str to str
            ROS parameter files as text, and the mapping's text where the bridge names a file.
        """
        answers: dict[str, str] = {}
        while not self._answers.empty():
            answers |= self._answers.get()
        return answers

    def close(self) -> None:
        """Ask no more; before ROS ends."""
        self._end.set()
        self._thread.join()

    def _ask(self) -> None:
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node

        wanted = [name for name, key in ASKED.items() if key not in self._attached]
        node, executor = Node("recorder_asks", start_parameter_services=False), None
        try:
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            until = time.monotonic() + _LOOKED_FOR_S
            while wanted and time.monotonic() < until and not self._end.wait(_LOOK_S):
                there = node.get_node_names()
                for name in [name for name in wanted if name in there]:
                    wanted.remove(name)
                    self._answers.put(self._told(name, _parameters(executor, node, name)))
        finally:
            if executor is not None:
                executor.shutdown()
            node.destroy_node()

    def _told(self, name: str, values: Mapping[str, Any]) -> dict[str, str]:
        if not values:
            return {}
        told = {ASKED[name]: _file(name, values)}
        mapping = str(values.get("mapping", "")) if name == "can_bridge" else ""
        if mapping and "mapping" not in self._attached:
            try:
                told["mapping"] = text_of(Path(mapping))
            except BagError as error:
                # No reason not to record.
                warn("recorder", [str(error)])
        return told


def _parameters(executor: Any, node: Any, name: str) -> dict[str, Any]:
    """Of a node that is there; empty where it does not answer."""
    from rclpy.parameter import parameter_value_to_python
    from rclpy.parameter_client import AsyncParameterClient

    def answer(future: Any) -> Any:
        executor.spin_until_future_complete(future, timeout_sec=_ANSWERED_S)
        return future.result() if future.done() else None

    client = AsyncParameterClient(node, name)
    if not client.wait_for_services(timeout_sec=_ANSWERED_S):
        return {}
    listed = answer(client.list_parameters())
    names = sorted(listed.result.names) if listed is not None else []
    got = answer(client.get_parameters(names)) if names else None
    if got is None:
        return {}
    return dict(zip(names, map(parameter_value_to_python, got.values), strict=True))


def _file(name: str, values: Mapping[str, Any]) -> str:
    """A ROS parameter file; arrays of numbers come as arrays, not as lists."""
    plain = {
        key: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
        for key, value in values.items()
    }
    return yaml.safe_dump({name: {"ros__parameters": plain}}, sort_keys=True)
