"""Layout for a log in Foxglove: the scene, text, and plots of what is true and what is believed."""

import json
from collections.abc import Sequence

from transport.colours import colour_of

PLOTS = (
    ("True cross-track error (m)", "deviation.cross_track_error_m"),
    ("Error as believed (m)", "tracking.lateral_error_m"),
    ("True gap (m)", "deviation.true_gap_m"),
    ("Believed gap (m)", "tracking.gap_m"),
    ("Age of the lead's newest pose (s)", "tracking.lead_age_s"),
)
"""Title, and topic with field, of what is plotted of each follower."""


AHEAD = (
    ("road known", "known_m", "#f2f2f2"),
    ("stop, comfortably", "comfortable_stop_m", "#6f8f4f"),
    ("stop, firmly", "firm_stop_m", "#d04040"),
)
"""Label, field and colour of what is plotted of the road ahead of one follower."""


def foxglove_layout(vehicles: Sequence[str]) -> str:
    """Lay out the log of a run of `vehicles`, lead first; to be imported in Foxglove."""
    plots = {f"Plot!{number}": _plot(vehicles, *row) for number, row in enumerate(PLOTS)}
    shown = {"StateTransitions!mode": _modes(vehicles)}
    if len(vehicles) > 1:
        shown["Plot!ahead"] = _road_ahead(vehicles[len(vehicles) // 2])
    left = {"first": "3D!scene", "second": "RosOut!text", "direction": "column"}
    layout = {
        "configById": {
            "3D!scene": _scene(vehicles),
            "RosOut!text": {"topicToRender": "/convoy/run/text", "minLogLevel": 1},
            **plots,
            **shown,
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "first": {**left, "splitPercentage": 75},
            "second": _stacked([*plots, *shown]),
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


def _plot(vehicles: Sequence[str], title: str, field: str) -> dict[str, object]:
    paths = [
        _path(f"/convoy/{name}/{field}", name, "#{:02x}{:02x}{:02x}".format(*colour_of(place)))
        for place, name in enumerate(vehicles)
        if place
    ]
    return _curves(title, paths)


def _road_ahead(vehicle: str) -> dict[str, object]:
    """How far the road ahead of one follower is known, and what a stop takes."""
    paths = [
        _path(f"/convoy/{vehicle}/tracking.{field}", label, colour)
        for label, field, colour in AHEAD
    ]
    return _curves(f"Road ahead of {vehicle} (m)", paths)


def _modes(vehicles: Sequence[str]) -> dict[str, object]:
    """What each follower steers along."""
    paths = [
        {"value": f"/convoy/{name}/tracking.mode", "label": name, "timestampMethod": "receiveTime"}
        for name in vehicles[1:]
    ]
    return {"foxglovePanelTitle": "Steers along", "paths": paths, "isSynced": True}


def _path(value: str, label: str, colour: str) -> dict[str, object]:
    return {
        "value": value,
        "label": label,
        "color": colour,
        "enabled": True,
        "timestampMethod": "receiveTime",
    }


def _curves(title: str, paths: Sequence[object]) -> dict[str, object]:
    return {
        "foxglovePanelTitle": title,
        "paths": paths,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
    }


def _stacked(panels: Sequence[str]) -> object:
    """Put panels of equal height below one another."""
    first, *rest = panels
    if not rest:
        return first
    share = 100.0 / len(panels)
    stack = {"first": first, "second": _stacked(rest), "direction": "column"}
    return {**stack, "splitPercentage": share}
