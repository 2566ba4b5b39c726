"""Foxglove layout of a log: scene, text and plots."""

import json
from collections.abc import Sequence

from transport.panels import PANELS, Panel

KINDS = {"plot": "Plot", "states": "StateTransitions", "plot_of_one": "Plot"}
"""Foxglove's panel types by kind of panel, from top to bottom."""


def foxglove_layout(vehicles: Sequence[str]) -> str:
    """Layout (JSON) of the log of a run with `vehicles`, lead first, for import in Foxglove."""
    panels = [panel for panel in PANELS.values() if panel.foxglove and panel.applies_to(vehicles)]
    panels.sort(key=lambda panel: list(KINDS).index(panel.kind))
    shown = {f"{KINDS[panel.kind]}!{panel.name}": _panel(panel, vehicles) for panel in panels}
    left = {"first": "3D!scene", "second": "RosOut!text", "direction": "column"}
    layout = {
        "configById": {
            "3D!scene": _scene(vehicles),
            "RosOut!text": {"topicToRender": "/convoy/run/text", "minLogLevel": 1},
            **shown,
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "first": {**left, "splitPercentage": 75},
            "second": _stacked(list(shown)),
            "direction": "row",
            "splitPercentage": 55,
        },
    }
    return json.dumps(layout, indent=1) + "\n"


def _scene(vehicles: Sequence[str]) -> dict[str, object]:
    shown = ["/convoy/run/road"]
    shown += [f"/convoy/{name}/{topic}" for name in vehicles for topic in ("box", "preview")]
    return {
        "followMode": "follow-position",
        "followTf": vehicles[len(vehicles) // 2],
        "cameraState": {
            "perspective": True,
            "distance": 20.0 + 12.0 * len(vehicles),
            "phi": 35.0,
            "thetaOffset": 0.0,
            "targetOffset": [0.0, 0.0, 0.0],
            "target": [0.0, 0.0, 0.0],
            "targetOrientation": [0.0, 0.0, 0.0, 1.0],
            "fovy": 45.0,
            "near": 0.5,
            "far": 5000.0,
        },
        "scene": {"transforms": {"visible": False}},
        "topics": {topic: {"visible": True} for topic in shown},
        "layers": {},
    }


def _panel(panel: Panel, vehicles: Sequence[str]) -> dict[str, object]:
    followers = panel.followers(vehicles)
    drawn = [(place, name, series) for place, name in followers.items() for series in panel.single]
    paths: list[dict[str, object]] = [
        {
            "value": f"/convoy/{name}/{series.topic}.{series.field}",
            "label": series.label_of(name),
            "timestampMethod": "receiveTime",
        }
        for _, name, series in drawn
    ]
    heading = panel.heading(next(iter(followers.values()), ""))
    shown = {"foxglovePanelTitle": heading, "paths": paths, "isSynced": True}
    if panel.kind == "states":
        return shown
    for path, (place, _, series) in zip(paths, drawn, strict=True):
        colour = "#{:02x}{:02x}{:02x}".format(*series.colour_at(place))
        path |= {"color": colour, "enabled": True}
    return {
        **shown,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "xAxisVal": "timestamp",
    }


def _stacked(panels: Sequence[str]) -> object:
    """Stack panels of equal height."""
    first, *rest = panels
    if not rest:
        return first
    share = 100.0 / len(panels)
    stack = {"first": first, "second": _stacked(rest), "direction": "column"}
    return {**stack, "splitPercentage": share}
