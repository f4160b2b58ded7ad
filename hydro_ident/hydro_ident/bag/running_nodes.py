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
from hydro_model.errors import HydroError
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.shipped_mapping import default_mapping

#: Nodes that are asked, each with the keys of the metadata that it can tell.
ASKED = {
    "controller": ("controller_parameters",),
    "can_bridge": ("bridge_parameters", "mapping"),
}
#: Nodes are looked for so often, have so long to answer, and that is looked at so often.
_LOOK_S, _ANSWERED_S, _TURN_S = 0.2, 2.0, 0.1


class RunningNodes:
    """Asks controller and bridge for their parameters while it is recorded.

    Discovery takes up to seconds, and a node that is being configured answers later still, which
    no recording waits for: a thread asks, and what it has learnt is fetched by whoever writes.

    Parameters
    ----------
    attached : collection of str
        Keys of the metadata that need no asking.
    """

    def __init__(self, attached: Collection[str]) -> None:
        missing = {node: set(keys) - set(attached) for node, keys in ASKED.items()}
        self._wanted = {node: keys for node, keys in missing.items() if keys}
        self._silent: set[str] = set()
        self._answers: SimpleQueue[dict[str, str]] = SimpleQueue()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._ask, daemon=True)
        self._thread.start()

    def learnt(self) -> dict[str, str]:
        """What has come since it was last asked, by key of the metadata.

        Returns
        -------
        dict of str to str
            ROS parameter files as text, and the text of the bridge's mapping.
        """
        answers: dict[str, str] = {}
        while not self._answers.empty():
            answers |= self._answers.get()
        return answers

    def close(self) -> None:
        """Ask no more, and say who was there and did not answer, once; before ROS ends."""
        self._end.set()
        self._thread.join()
        silent, self._silent = sorted(self._silent), set()
        for name in silent:
            keys = " and ".join(sorted(self._wanted[name]))
            warn("recorder", [f"/{name} did not answer: the bag is without {keys}"])

    def _ask(self) -> None:
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node

        wanted = list(self._wanted)
        node = Node("recorder_asks", start_parameter_services=False)
        executor = SingleThreadedExecutor()
        try:
            executor.add_node(node)
            while wanted and not self._end.wait(_LOOK_S):
                there = node.get_node_names()
                for name in [name for name in wanted if name in there]:
                    self._silent.add(name)
                    values = self._parameters(executor, node, name)
                    if values:
                        self._silent.remove(name)
                        wanted.remove(name)
                        self._answers.put(self._told(name, values))
        finally:
            executor.shutdown()
            node.destroy_node()

    def _parameters(self, executor: Any, node: Any, name: str) -> dict[str, Any]:
        """Of a node that is there; empty where it does not answer."""
        from rclpy.parameter import parameter_value_to_python
        from rclpy.parameter_client import AsyncParameterClient

        client = AsyncParameterClient(node, name)
        until = time.monotonic() + _ANSWERED_S

        def answer(future: Any) -> Any:
            while not (future.done() or self._end.is_set() or time.monotonic() > until):
                executor.spin_until_future_complete(future, timeout_sec=_TURN_S)
            return future.result() if future.done() else None

        while not client.services_are_ready():
            if self._end.wait(_TURN_S) or time.monotonic() > until:
                return {}
        listed = answer(client.list_parameters())
        names = sorted(listed.result.names) if listed is not None else []
        got = answer(client.get_parameters(names)) if names else None
        # One that no longer has some of them answers with nothing at all.
        if got is None or len(got.values) != len(names):
            return {}
        return dict(zip(names, map(parameter_value_to_python, got.values), strict=True))

    def _told(self, name: str, values: Mapping[str, Any]) -> dict[str, str]:
        parameters, *others = ASKED[name]
        told = {parameters: _file(name, values)}
        if "mapping" in others and "mapping" in self._wanted[name]:
            try:
                told["mapping"] = text_of(_mapping(values))
            except HydroError as error:
                # No reason not to record.
                warn("recorder", [str(error)])
        return {key: text for key, text in told.items() if key in self._wanted[name]}


def _mapping(values: Mapping[str, Any]) -> Path:
    """The file that a bridge of these parameters reads; shipped where it names none."""
    named = Path(str(values.get("mapping", "")))
    if not named.name:
        return default_mapping(load_robot(str(values["robot"]), bounded=True).name)
    if not named.is_absolute():
        raise BagError(f"{named}: cannot be attached: the bridge's folder is not known")
    return named


def _file(name: str, values: Mapping[str, Any]) -> str:
    """A ROS parameter file; arrays of numbers come as arrays, not as lists."""
    plain = {
        key: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
        for key, value in values.items()
    }
    return yaml.safe_dump({name: {"ros__parameters": plain}}, sort_keys=True)
