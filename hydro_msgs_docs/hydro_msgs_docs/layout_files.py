"""Layout files of PlotJuggler and Foxglove from views."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

from hydro_msgs_docs import topics
from hydro_msgs_docs.live_layouts import Plot, View

_STREAMER = "ROS2 Topic Subscriber"


def plotjuggler(view: View) -> str:
    """A layout file of PlotJuggler; its streamer subscribes to what the plots show.

    Parameters
    ----------
    view : View

    Returns
    -------
    str
    """
    root = ElementTree.Element("root")
    place = {"parent": "main_window", "name": "Main Window"}
    window = ElementTree.SubElement(root, "tabbed_widget", place)
    tab = ElementTree.SubElement(window, "Tab", tab_name=view.name, containers="1")
    container = ElementTree.SubElement(tab, "Container")
    rows = view.shown
    column = ElementTree.SubElement(container, "DockSplitter", _split("-", len(rows)))
    for row in rows:
        across = ElementTree.SubElement(column, "DockSplitter", _split("|", len(row)))
        for plot in row:
            _dock(across, plot)
    plugins = ElementTree.SubElement(root, "Plugins")
    _streamer(ElementTree.SubElement(plugins, "plugin", ID=_STREAMER), view)
    ElementTree.SubElement(root, "previouslyLoaded_Streamer", name=_STREAMER)
    ElementTree.indent(root, " ")
    return (
        "<?xml version='1.0' encoding='UTF-8'?>\n" + ElementTree.tostring(root, "unicode") + "\n"
    )


def _split(orientation: str, count: int) -> dict[str, str]:
    sizes = ";".join([f"{1.0 / count:.6f}"] * count)
    return {"orientation": orientation, "count": str(count), "sizes": sizes}


def _dock(parent: ElementTree.Element, plot: Plot) -> None:
    area = ElementTree.SubElement(parent, "DockArea", name=plot.title)
    look = {"mode": "TimeSeries", "style": "Lines", "flip_x": "false", "flip_y": "false"}
    frame = ElementTree.SubElement(area, "plot", look)
    ElementTree.SubElement(frame, "range", left="0", right="10", bottom="0", top="1")
    ElementTree.SubElement(frame, "limitY")
    for signal in plot.signals:
        ElementTree.SubElement(frame, "curve", name=signal.plotjuggler, color=signal.colour)


def _streamer(parent: ElementTree.Element, view: View) -> None:
    names = list(dict.fromkeys(signal.topic for signal in view.signals))
    if view.diagnostics:
        names.append(topics.DIAGNOSTICS)
    for key, value in (
        ("use_header_stamp", "true"),
        ("discard_large_arrays", "true"),
        ("max_array_size", "100"),
        ("boolean_strings_to_number", "true"),
        ("remove_suffix_from_strings", "true"),
        ("selected_topics", ";".join(names)),
    ):
        ElementTree.SubElement(parent, key, value=value)


def foxglove(view: View) -> str:
    """A layout file of Foxglove.

    Parameters
    ----------
    view : View

    Returns
    -------
    str
    """
    panels: dict[str, Any] = {}
    rows: list[Any] = []
    for r, row in enumerate(view.shown):
        names = [f"Plot!{view.name}{r}{k}" for k in range(len(row))]
        panels |= {name: _panel(plot) for name, plot in zip(names, row, strict=True)}
        rows.append(_tree(names, "row"))
    layout = _tree(rows, "column")
    if view.diagnostics:
        summary = f"DiagnosticSummary!{view.name}"
        panels[summary] = {
            "minLevel": 0,
            "pinnedIds": [],
            "hardwareIdFilter": "",
            "topicToRender": topics.DIAGNOSTICS,
            "sortByLevel": True,
        }
        layout = {"first": layout, "second": summary, "direction": "row", "splitPercentage": 75}
    whole: Mapping[str, Any] = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": layout,
    }
    return json.dumps(whole, indent=2) + "\n"


def _panel(plot: Plot) -> dict[str, Any]:
    return {
        "title": plot.title,
        "foxglovePanelTitle": plot.title,
        "paths": [
            {
                "value": signal.foxglove,
                "label": signal.label,
                "enabled": True,
                "timestampMethod": "headerStamp",
                "color": signal.colour,
            }
            for signal in plot.signals
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "xAxisVal": "timestamp",
        "followingViewWidth": 10,
    }


def _tree(parts: Sequence[Any], direction: str) -> Any:
    """Parts of equal size beside or below one another, as a tree of pairs."""
    first, *others = parts
    if not others:
        return first
    rest = _tree(others, direction)
    share = round(100.0 / len(parts), 3)
    return {"first": first, "second": rest, "direction": direction, "splitPercentage": share}
