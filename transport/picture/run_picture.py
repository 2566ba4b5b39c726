"""Draws a run into a recording of Rerun, live or from its log, batch by batch."""

import textwrap
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from transport.columns import Columns, Integers, ranges
from transport.panels import PANELS, Colour, colour_of, colours_of_sources
from transport.picture.batch import BATCH_NS, Batch, Floats, Mark, RunScene, VehicleValues
from transport.picture.layout import (
    EVENTS,
    FEW_VEHICLES,
    MARKS,
    SHOWN_ABOUT,
    WORST,
    Reach,
    RunExtent,
    blueprint,
    detailed,
    plan_tag_m,
)
from transport.picture.rows import RowSender, frames_of, packed, strips_of
from transport.picture.series import PanelSeries
from transport.picture.shapes import (
    CarShape,
    car,
    draw_road,
    legend,
    line_style,
    points,
    road_marks,
)
from transport.picture.trajectories import lines_of
from vehicles.schedule import MILLISECOND, SECOND

CAR_NS = 40 * MILLISECOND
TRAJECTORY_NS = 100 * MILLISECOND
DRIVEN_NS = 200 * MILLISECOND
SILENT_NS = SECOND  # Time without a pose after which the view does not have to contain a vehicle
LATE_ERROR_NS = SECOND  # How late an error is known: the path of the lead has to be known first
WORST_FROM_M = 0.2  # Error from which the vehicle furthest off the lead's path is marked
MAX_ZOOM = 4.0  # Largest zoom of the moving view that a vehicle other than the lead causes
MOST_LINKS = 8  # Links with problems that are in view at once
ROW_RATIO = 0.75  # Distance between rows of names, in distances of name tags
LINE_LENGTH = 78  # Characters of a log line that fit in a window of 1280 pixels
_LEVELS = {"debug": "DEBUG", "warning": "WARN", "fatal": "CRITICAL"}
_LEVELS |= dict.fromkeys(("error", "alert"), "ERROR")  # others are "INFO"


class Track(NamedTuple):
    """East, north (m) and yaw (rad) of a vehicle, (N, 3), at instants (ns) in order, (N)."""

    at_ns: Integers
    poses: Floats

    def rows(self, at: Integers) -> Integers:
        """Rows of the last poses at instants (ns), or of the first one before it."""
        return np.maximum(np.searchsorted(self.at_ns, at, side="right") - 1, 0)


class RunPicture:
    """Turns batches of tables into entities of a recording, at the rates that a viewer needs.

    Every value of the errors and gaps is drawn, so the extremes are those of the summary. Batches
    of any length give the same rows.
    """

    def __init__(self, recording: rr.RecordingStream, scene: RunScene) -> None:
        self._recording = recording
        self._scene = scene
        self._lead = scene.vehicles[0]
        self._detailed = detailed(scene.vehicles)
        self._reach = Reach.of(scene)
        self._places = {name: place for place, name in enumerate(scene.convoy)}
        self._sender = RowSender(recording)
        self._send, self._due = self._sender.send, self._sender.due
        self._series = PanelSeries(self._sender, self._detailed, self._places.__getitem__)
        self._tracks: dict[str, Track] = {}
        self._driven: dict[str, Floats] = {}
        self._newest = 0  # instant of the latest pose
        self._errors: defaultdict[int, dict[str, float]] = defaultdict(dict)
        self._largest_errors: dict[str, float] = {}
        self._marked: defaultdict[str, set[str]] = defaultdict(set)
        recording.send_blueprint(blueprint(scene, RunExtent(scene.duration_s)))
        for name in scene.vehicles:
            self._add_vehicle(name, colour_of(self._places[name]))
        draw_road(recording, scene)
        marks = road_marks(*scene.path, self._reach.tag_m)
        recording.log("world/road/marks", marks, static=True)
        at = (0.0, plan_tag_m(scene.path))
        tag = points(order=30, colour=colour_of(0), text=self._lead, at=at)
        recording.log(f"world/cars/{self._lead}/plan_name", tag, static=True)
        self._log_legend()

    def draw(self, batch: Batch) -> None:
        """Draw the next messages of the run."""
        self._sender.start = batch.start_ns
        self._series.draw(batch)
        new = [self._draw_car(truth) for truth in batch.of_topic("truth")]
        self._move_view(np.unique(np.concatenate([np.empty(0, np.int64), *new])))
        for trajectories in batch.of_topic("trajectory"):
            if trajectories.vehicle in self._detailed:
                self._draw_trajectories(trajectories)
        self._draw_worst(batch.errors, self._newest - LATE_ERROR_NS)
        self._draw_marks([*batch.marks, *self._draw_texts(batch)])

    def finish(self) -> None:
        """Fit layout and legend to the run."""
        if not self._tracks:
            return
        self._draw_worst({}, self._newest + 1)
        by_error = sorted(self._largest_errors, key=self._largest_errors.__getitem__, reverse=True)
        troubled = set[str]().union(*(self._marked[kind] for kind in EVENTS))
        vehicles = [name for name in by_error if name in troubled or name == by_error[0]]
        duration_s = (self._newest - self._sender.start) / SECOND
        troubles = self._series.link_troubles
        links = sorted((link for link in troubles if troubles[link]), key=lambda x: -troubles[x])
        worst = links[:MOST_LINKS]
        extent = RunExtent(duration_s, vehicles, worst, len(worst) < len(troubles))
        self._recording.send_blueprint(blueprint(self._scene, extent))
        self._log_legend()

    # ---- Vehicles

    def _add_vehicle(self, vehicle: str, colour: Colour) -> None:
        size = CarShape(*self._scene.cars[vehicle])
        shapes = {
            f"cars/{vehicle}/body": car(size, colour),
            f"cars/{vehicle}/dot": points(width=5.0, order=21, colour=colour, at=(0.0, 0.0)),
            f"cars/{vehicle}/worst": points(width=18.0, order=15, colour=WORST),
            f"cars/{vehicle}/worst/name": points(order=42, colour=WORST),
            f"convoy/names/{vehicle}": points(order=30, colour=colour, text=vehicle),
            f"driven/{vehicle}": line_style(colour, width=1.0, order=5),
            f"trajectory/{vehicle}": line_style(colour, width=1.5, order=23),
            f"samples/{vehicle}": points(width=3.0, order=24),
        }
        for entity, shape in shapes.items():
            self._recording.log(f"world/{entity}", shape, static=True)

    def _draw_car(self, truth: Columns) -> Integers:
        """Draw the positions of a car and the path that it drove; returns the instants (ns)."""
        vehicle = truth.vehicle
        rows = self._due(vehicle, "car", truth.at_ns, CAR_NS)
        at = truth.at_ns[rows]
        poses = np.column_stack([truth[name][rows] for name in ("east_m", "north_m", "yaw_rad")])
        self._newest = max(self._newest, int(truth.at_ns.max()))
        self._send(f"world/cars/{vehicle}", at, frames_of(poses))
        track = self._tracks.get(vehicle, Track(at[:0], poses[:0]))
        self._tracks[vehicle] = Track(*map(np.concatenate, zip(track, (at, poses), strict=True)))
        # The path driven comes in pieces, each from the end of the last one.
        before = self._driven.get(vehicle, poses[:0, :2])
        line = np.concatenate((before, poses[:, :2]))
        rows = self._due(vehicle, "driven", at, DRIVEN_NS)
        if rows.size:
            ends = len(before) + rows
            starts = np.concatenate(([0], ends[:-1]))
            counts = ends - starts + 1
            pieces = strips_of(counts, line[ranges(starts, counts, 1)])
            self._send(f"world/driven/{vehicle}", at[rows], pieces)
            line = line[ends[-1] :]
        self._driven[vehicle] = line
        return at

    def _draw_trajectories(self, trajectories: Columns) -> None:
        vehicle = trajectories.vehicle
        rows = self._due(vehicle, "trajectory", trajectories.at_ns, TRAJECTORY_NS)
        drawn = trajectories.of(rows)
        if not len(drawn):
            return
        self._send(f"world/trajectory/{vehicle}", drawn.at_ns, strips_of(*lines_of(drawn)))
        offsets, source = drawn.lists["sample_source"]
        axes = ("sample_east_m", "sample_north_m")
        spots = np.column_stack([drawn.lists[axis].values for axis in axes])
        colours = packed(colours_of_sources(self._places[vehicle]))
        used = colours[np.clip(source, 0, len(colours) - 1)]
        samples = rr.Points2D.columns(positions=spots, colors=used).partition(np.diff(offsets))
        self._send(f"world/samples/{vehicle}", drawn.at_ns, samples)

    # ---- The moving view

    def _move_view(self, at: Integers) -> None:
        """Move the view at instants (ns) with a car, zoomed out to contain the others.

        It follows the middle of the detailed vehicles, and if that sends nothing the next vehicle
        towards an end of the convoy that does.
        """
        if not at.size:
            return
        names, tracks = list(self._tracks), list(self._tracks.values())
        poses = np.stack([track.poses[track.rows(at)] for track in tracks])
        seen = np.stack([track.at_ns[track.rows(at)] for track in tracks])
        sends = (seen <= at) & (at - seen <= SILENT_NS)  # (vehicles, instants)
        places = np.array([self._places[name] for name in names])
        middle = self._places[self._detailed[len(self._detailed) // 2]]
        nearest = np.argsort(np.abs(places - middle), kind="stable")
        followed = nearest[np.argmax(sends[nearest], axis=0)]
        eye = poses[followed, np.arange(len(at))]
        to_east, to_north = np.moveaxis(poses[:, :, :2] - eye[:, :2], 2, 0)
        cos, sin = np.cos(eye[:, 2]), np.sin(eye[:, 2])
        ahead, left = to_east * cos + to_north * sin, to_north * cos - to_east * sin
        most = np.where([name == self._lead for name in names], np.inf, MAX_ZOOM)[:, None]
        zooms = np.minimum(self._reach.zooms_for(ahead, left), most)
        is_shown = sends & (np.abs(places[:, None] - places[followed]) <= SHOWN_ABOUT)
        zoom = np.where(is_shown, zooms, 1.0).max(axis=0)
        self._send("world/convoy", at, frames_of(eye, zoom, flip=True))
        for name, place, x, y in zip(names, places.tolist(), ahead, left, strict=True):
            # Names have a fixed distance on the screen, in a long convoy two of them in turn.
            tag_rows = 1 + place % 2 if len(self._places) > FEW_VEHICLES else 1
            spots = np.column_stack((x / zoom, -y / zoom - tag_rows * self._reach.tag_m))
            self._send(f"world/convoy/names/{name}", at, rr.Points2D.columns(positions=spots))

    # ---- The vehicle furthest off

    def _draw_worst(self, errors: Mapping[str, VehicleValues], until: int) -> None:
        """Ring the vehicle furthest off the lead's path in each half second before `until` (ns)."""
        for name, (at, values) in errors.items():
            largest = max(self._largest_errors.get(name, 0.0), float(np.abs(values).max()))
            self._largest_errors[name] = largest
            rows = self._due(name, "worst", at, BATCH_NS)
            windows = at[rows] - (at[rows] - self._sender.start) % BATCH_NS
            for window, value in zip(windows.tolist(), values[rows].tolist(), strict=True):
                self._errors[window][name] = value
        rings: defaultdict[str, list[tuple[int, str]]] = defaultdict(list)
        for window in sorted(window for window in self._errors if window < until):
            first = self._errors.pop(window)
            worst = max(first, key=lambda name: abs(first[name]))
            for name, error in first.items():
                is_ringed = name == worst and abs(error) > WORST_FROM_M
                rings[name].append((window, f"{name} {error:+.2f} m" if is_ringed else ""))
        for name, rows_of_name in rings.items():
            at = np.array([window for window, _ in rows_of_name], np.int64)
            counts = np.array([bool(label) for _, label in rows_of_name], np.int64)
            spots = np.zeros((int(counts.sum()), 2))
            ring = rr.Points2D.columns(positions=spots)
            text = rr.Points2D.columns(
                positions=spots - [0.0, 0.6 * self._reach.tag_m],
                labels=[label for _, label in rows_of_name if label],
            )
            self._send(f"world/cars/{name}/worst", at, ring.partition(counts))
            self._send(f"world/cars/{name}/worst/name", at, text.partition(counts))

    # ---- Texts, changes and events

    def _draw_texts(self, batch: Batch) -> list[Mark]:
        """Show log lines and changes as text; returns marks of the changes, at their vehicles."""
        texts: defaultdict[str, list[tuple[int, str, str]]] = defaultdict(list)
        marks = []
        for lines in batch.of_topic("log"):
            levels = [_LEVELS.get(level, "INFO") for level in lines["level"].tolist()]
            at_ns, contents = lines.at_ns.tolist(), lines["text"].tolist()
            texts[lines.vehicle] += zip(at_ns, levels, contents, strict=True)
        for changes in batch.of_topic("change"):
            name = changes.vehicle
            fields = (changes[field].tolist() for field in ("kind", "by_hand", "table"))
            for at, kind, by_hand, table in zip(changes.at_ns.tolist(), *fields, strict=True):
                text = f"change{' by hand' if by_hand else ''}: {table}"
                texts[name].append((at, "INFO", text))
                if (pose := self._pose_at(name, at)) is not None:
                    marks.append(Mark("change", at, (pose[0], pose[1]), (name,), kind))
        for vehicle, rows in texts.items():
            self._draw_lines(vehicle, sorted(rows, key=lambda row: row[0]))
        return marks

    def _draw_lines(self, vehicle: str, texts: Sequence[tuple[int, str, str]]) -> None:
        """Draw texts, one row per line: the viewer shows only the first line of a row."""
        at, lines, levels = [], list[str](), list[str]()
        for when, level, text in texts:
            wrapped = textwrap.wrap(
                f"{(when - self._sender.start) / SECOND:8.2f} s  {vehicle}: {text}",
                LINE_LENGTH,
                subsequent_indent=" " * 12,
            )
            lines += wrapped
            at += [when] * len(wrapped)
            levels += [level, *[""] * (len(wrapped) - 1)]
        columns = rr.TextLog.columns(text=lines, level=levels)
        self._send(f"log/{vehicle}", np.array(at, np.int64), columns)

    def _draw_marks(self, marks: Sequence[Mark]) -> None:
        """Draw marks at their places in the plans, and on the zero line in the plots.

        Names are to the right of the road, in a row for each kind.
        """
        by_kind: defaultdict[str, list[Mark]] = defaultdict(list)
        for mark in sorted(marks, key=lambda mark: mark.at_ns):
            by_kind[mark.kind].append(mark)
        for kind, some in by_kind.items():
            self._marked[kind].update(*(mark.vehicles for mark in some))
            at = np.array([mark.at_ns for mark in some], np.int64)
            places = np.array([mark.place for mark in some])
            right_m = self._reach.tag_m * (1.0 + ROW_RATIO * list(MARKS).index(kind))
            poses = [self._pose_at(mark.vehicles[-1], mark.at_ns) for mark in some]
            yaw = np.array([0.0 if pose is None else pose[2] for pose in poses])
            names = rr.Points2D.columns(
                positions=places + right_m * np.column_stack((np.sin(yaw), -np.cos(yaw))),
                labels=[mark.label for mark in some],
            )
            entity, colour = f"world/events/{kind}", MARKS[kind][0]
            self._sender.style(entity, points(width=6.0, order=40, colour=colour))
            self._send(entity, at, rr.Points2D.columns(positions=places))
            self._sender.style(f"{entity}/name", points(order=41, colour=colour))
            self._send(f"{entity}/name", at, names)
            label = kind.replace("_", " ")
            plots = [_marked_plots(mark.vehicles[-1:]) for mark in some]
            for plot in dict.fromkeys(plot for of_mark in plots for plot in of_mark):
                times = at[[plot in of_mark for of_mark in plots]]
                self._sender.zero_marks(f"{plot}/events/{kind}", times, label, MARKS[kind])

    def _pose_at(self, vehicle: str, at: int) -> Floats | None:
        """East, north (m) and yaw (rad) of a vehicle at an instant (ns), if known."""
        track = self._tracks.get(vehicle)
        return None if track is None else track.poses[int(track.rows(np.array(at)))]

    def _log_legend(self) -> None:
        """Show the colours of vehicles, of curves with their own colours, and of marks."""
        items = [
            (f"{name} (lead)" if name == self._lead != "lead" else name, colour_of(place))
            for name, place in self._places.items()
            if name in self._detailed
        ]
        curves = [series for panel in PANELS.values() for series in panel.series]
        if len(items) > 1:
            items += [(curve.label, curve.colour) for curve in curves if curve.colour]
        kinds = [kind for kind in MARKS if self._marked.get(kind)]
        items += [(kind.replace("_", " "), MARKS[kind][0]) for kind in kinds]
        self._recording.log("legend", legend(items), static=True)


def _marked_plots(vehicles: Sequence[str]) -> tuple[str, ...]:
    """Marked plots of all vehicles, and those of each of `vehicles`."""
    marked = [panel for panel in PANELS.values() if panel.marked]
    common = [f"plots/{panel.name}" for panel in marked if panel.kind == "plot"]
    own = [f"plots/{panel.name}" for panel in marked if panel.kind == "plot_of_one"]
    return (*common, *(f"{plot}/{name}" for plot in own for name in vehicles))
