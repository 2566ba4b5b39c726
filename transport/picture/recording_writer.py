"""Draws messages into a Rerun recording, live or from a log."""

import math
import textwrap
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import rerun as rr

from transport.panels import PANELS, SLOW_CURVE_NS, Colour, colour_of, colours_of_sources
from transport.picture.blueprint import (
    FEW_VEHICLES,
    MARKS,
    TIMELINE,
    WORST,
    Detail,
    Reach,
    Road,
    RunExtent,
    blueprint,
    is_small,
    middle,
    plan_tag_m,
)
from transport.picture.curves import Curves, PanelSeries, States
from transport.picture.moving_rows import MovingRows
from transport.picture.shapes import (
    CarShape,
    Mark,
    Marks,
    car,
    lane_edges,
    legend,
    line_style,
    name_tag,
    plan_frame,
    point_style,
    ring,
    ring_label,
    road_with_marks,
)
from transport.topics import valid_at
from vehicles.geometry.arc_spline import points_along
from vehicles.messages import (
    Change,
    Command,
    CompositeTrajectory,
    LinkVerdict,
    LogText,
    Message,
    RunEnd,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import MILLISECOND, SECOND, Timer

CAR_NS = 40 * MILLISECOND
TRAJECTORY_NS = 100 * MILLISECOND
DRIVEN_NS = 200 * MILLISECOND
BATCH_NS = 500 * MILLISECOND  # Period of sending the curves: batches cost a tenth of single values
MOVING_NS = 100 * MILLISECOND  # Period of sending the positions
SILENT_NS = SECOND  # Time without a pose after which the view follows another vehicle
SPACING_M = 1.0
WORST_FROM_M = 0.2  # Error from which the vehicle furthest off the lead's path is marked
DEFAULT_CAR = CarShape(4.93, 1.86, -0.1568)  # A Lincoln MKZ, for vehicles of unknown size
MAX_ZOOM = 4.0  # Largest zoom of the moving view that a vehicle other than the lead causes
ZOOM_STEP = 1.25  # Change of that zoom after which name tags are placed again
LINE_LENGTH = 78  # Characters of a log line that fit in a window of 1280 pixels
_LEVELS = {
    "debug": "DEBUG",
    "info": "INFO",
    "warning": "WARN",
    "error": "ERROR",
    "alert": "ERROR",
    "fatal": "CRITICAL",
}


class RecordingWriter:
    """Turns messages into entities of a recording, at the rates that a viewer needs.

    Every value of the errors and gaps is drawn, so the extremes are those of the summary. In a long
    convoy this applies to the vehicles of `detail`.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        vehicles: Sequence[str],
        *,
        spacing_m: float,
        cars: Mapping[str, CarShape],
        path: Road | None = None,
        lane_m: float | None = None,
        duration_s: float | None = None,
        convoy: Sequence[str] = (),
    ) -> None:
        """Draw `vehicles`, lead first, which may be some of a `convoy`."""
        self._recording = recording
        self._convoy = tuple(convoy or vehicles)
        self._cars = cars
        self._lead = vehicles[0]
        self._layout = partial(blueprint, vehicles, spacing_m=spacing_m, road=path)
        self.detail = Detail(vehicles)
        self._reach = Reach.of(self.detail.shown, spacing_m, path)
        self._start: int | None = None
        self._waiting: list[tuple[int, Message]] = []
        self._places: dict[str, int] = {}
        self._timers: dict[tuple[str, str], Timer] = {}
        self._curves = Curves(recording)
        states = States(recording, self._set_time)
        self._series = PanelSeries(self._curves, states, self.detail)
        self._moving = MovingRows(recording)
        self._moving_timer = Timer(MOVING_NS)
        self._driven: defaultdict[str, list[tuple[float, float]]] = defaultdict(list)
        self._errors: dict[str, float] = {}
        self._largest_errors: dict[str, float] = {}
        self._positions: dict[str, tuple[float, float]] = {}
        self._yaw: dict[str, float] = {}
        self._last_pose_at: dict[str, int] = {}
        self._followed = self.detail.followed
        self._batch = Timer(BATCH_NS)
        self._car_ns, self._driven_ns = map(self.detail.period, (CAR_NS, DRIVEN_NS))
        self._trajectory_ns = self.detail.period(TRAJECTORY_NS)
        self._time_at: int | None = None
        self._worst = ""
        self._zoom_level: int | None = None
        self._marked: dict[str, Colour] = {}
        self._draw: dict[type[Message], Callable[[Any], None]] = {
            TruePose: self._true_pose,
            CompositeTrajectory: self._trajectory,
            Tracking: self._draw_series,
            Command: self._draw_series,
            LinkVerdict: self._verdict,
            LogText: self._log_line,
            Change: self._change,
        }
        recording.send_blueprint(self._layout(extent=RunExtent(duration_s)))
        self._marks = Marks(recording, vehicles[1:])
        recording.log("world/plan", plan_frame(), static=True)
        for name in vehicles:
            self._place(name)
        self._log_legend()
        if path:
            self._log_road(path, lane_m, spacing_m)

    def draw(self, now: int, message: Message) -> None:
        """Draw a message received at `now` (ns), at the instant at which it was valid."""
        if self._start is None:
            self._wait_for_start(now, message)
            return
        draw = self._draw.get(type(message))
        if draw:
            draw(message)
        if self._moving_timer.is_due(now):
            self._moving.send(self._start or 0)
        if self._batch.is_due(now) or isinstance(message, RunEnd):
            self.send(now)

    def send(self, now: int) -> None:
        self._curves.send(self._start or 0)
        self._show_worst(max(self._last_pose_at.values(), default=now))

    def error(self, vehicle: str, at: int, error: float) -> None:
        """Draw the true cross-track error (m) of a vehicle at instant `at` (ns)."""
        self._errors[vehicle] = error
        if vehicle in self.detail:
            self._largest_errors[vehicle] = max(self._largest_errors.get(vehicle, 0.0), abs(error))
            self._add_value("cross_track", vehicle, at, error)

    def gap(self, vehicle: str, at: int, gap: float) -> None:
        """Draw the true gap (m) of a vehicle to the body ahead at instant `at` (ns)."""
        self._add_value("true_gap", vehicle, at, gap)

    def _add_value(self, quantity: str, vehicle: str, at: int, value: float) -> None:
        if not self._curves.has(quantity, vehicle):
            self._curves.start(quantity, vehicle, vehicle, colour_of(self._place(vehicle)))
        self._curves.add(quantity, vehicle, at, value)

    def mark(self, mark: Mark) -> None:
        self._set_time(mark.at_ns)
        self._marks.draw(mark, self._yaw.get(mark.vehicles[-1], 0.0), self._tag_m)
        if mark.kind not in self._marked:
            self._marked[mark.kind] = MARKS[mark.kind][0]
            self._log_legend()

    def finish(self) -> None:
        """Send the last batch, also of a truncated log, and fit the layout to the run."""
        start = self._start or 0
        self._curves.send(start)
        self._moving.send(start)
        if self._last_pose_at:
            duration_s = (max(self._last_pose_at.values()) - start) / SECOND
            worst = max(self._largest_errors, key=self._largest_errors.__getitem__, default="")
            extent = RunExtent(duration_s, worst)
            self._recording.send_blueprint(self._layout(extent=extent))

    def _wait_for_start(self, now: int, message: Message) -> None:
        """Keep messages until the start of the run is known: times are relative to it."""
        self._waiting.append((now, message))
        if isinstance(message, RunStart | TruePose):
            self._start = valid_at(message)
            for then, early in self._waiting:
                self.draw(then, early)
            self._waiting.clear()

    def _true_pose(self, truth: TruePose) -> None:
        vehicle, at = truth.vehicle, truth.true_at_ns
        self._last_pose_at[vehicle] = at
        self._draw_series(truth)
        if vehicle in self.detail and self._is_due(vehicle, "links", at, SLOW_CURVE_NS):
            self._series.show_links(vehicle, self._place(vehicle), at)
        if not self._is_due(vehicle, "car", at, self._car_ns):
            return
        self._set_time(at)
        self._positions[vehicle] = (truth.east_m, truth.north_m)
        self._yaw[vehicle] = truth.yaw_rad
        here = (truth.east_m, truth.north_m, truth.yaw_rad, False, 1.0)
        self._moving.add_frame(f"world/cars/{vehicle}", at, here)
        if vehicle == self._vehicle_to_follow(at):
            self._move_along(truth)
        driven = self._driven[vehicle]
        driven.append((truth.east_m, truth.north_m))
        if self._is_due(vehicle, "driven", at, self._driven_ns):
            self._moving.add_line(f"world/driven/{vehicle}", at, driven.copy())
            del driven[:-1]

    def _move_along(self, truth: TruePose) -> None:
        """Move the view to this vehicle, zoomed out to contain the others."""
        c, s = math.cos(truth.yaw_rad), math.sin(truth.yaw_rad)
        unit = 1.0
        place = self._place(truth.vehicle)
        for name, (east, north) in self._positions.items():
            if truth.true_at_ns - self._last_pose_at[name] > SILENT_NS:
                continue
            if not self.detail.shows(self._place(name), place):
                continue
            to_east, to_north = east - truth.east_m, north - truth.north_m
            zoom = self._reach.zoom_for(to_east * c + to_north * s, to_north * c - to_east * s)
            unit = max(unit, zoom if name == self._lead else min(zoom, MAX_ZOOM))
        eye = (truth.east_m, truth.north_m, truth.yaw_rad, True, unit)
        self._moving.add_frame("world/convoy", truth.true_at_ns, eye)
        level = round(math.log(unit, ZOOM_STEP))
        if level != self._zoom_level:
            self._zoom_level = level
            for name in self._places:
                self._log_name(name)

    @property
    def _tag_m(self) -> float:
        return float(self._reach.tag_m * ZOOM_STEP ** (self._zoom_level or 0))  # m

    def _log_name(self, vehicle: str) -> None:
        """Write the name of a vehicle next to it, at two distances in turn in a long convoy."""
        place = self._place(vehicle)
        rows = 1 + place % 2 if len(self._places) > FEW_VEHICLES else 1
        name = name_tag(vehicle, colour_of(place), rows * self._tag_m)
        self._recording.log(f"world/cars/{vehicle}/name", name)

    def _log_legend(self) -> None:
        """Show the colours of vehicles, of curves with their own colours, and of marks."""
        items = [
            (f"{name} (lead)" if name == self._lead != "lead" else name, colour_of(place))
            for name, place in self._places.items()
            if name in self.detail
        ]
        if not self.detail.is_all:
            items.append(("furthest off", WORST))
        if len(items) > 1:
            items += [
                (series.label, series.colour)
                for panel in PANELS.values()
                for series in panel.series
                if series.colour
            ]
        items += [(kind.replace("_", " "), colour) for kind, colour in self._marked.items()]
        self._recording.log("legend", legend(items), static=True)

    def _trajectory(self, trajectory: CompositeTrajectory) -> None:
        vehicle, at = trajectory.vehicle, trajectory.decided_at_ns
        if vehicle not in self.detail:
            return
        if not self._is_due(vehicle, "trajectory", at, self._trajectory_ns):
            return
        self._set_time(at)
        points = [(east, north) for east, north, _ in points_along(trajectory, SPACING_M)]
        ahead = rr.LineStrips2D.from_fields(strips=[points])
        self._recording.log(f"world/trajectory/{vehicle}", ahead)
        sources = colours_of_sources(self._place(vehicle))
        samples = rr.Points2D.from_fields(
            positions=list(zip(trajectory.sample_east_m, trajectory.sample_north_m, strict=False)),
            colors=[sources[min(source, len(sources) - 1)] for source in trajectory.sample_source],
        )
        self._recording.log(f"world/samples/{vehicle}", samples)

    def _draw_series(self, message: Tracking | Command | TruePose) -> None:
        self._series.draw(message, self._place(message.vehicle))

    def _verdict(self, verdict: LinkVerdict) -> None:
        if verdict.vehicle in self.detail:
            self._series.count(verdict)

    def _show_worst(self, newest: int) -> None:
        """Ring the vehicle furthest off the lead's path at the `newest` pose (ns)."""
        name = max(self._errors, key=lambda vehicle: abs(self._errors[vehicle]), default="")
        if not name or abs(self._errors[name]) <= WORST_FROM_M:
            name = ""
        self._set_time(newest)
        if self._worst not in {name, ""}:
            self._ring(self._worst, "")
        if name:
            self._ring(name, f"{name} {self._errors[name]:+.2f} m")
        self._worst = name
        if self._errors and not self.detail.is_all:  # some vehicles have no curve
            worst = max(map(abs, self._errors.values()))
            if not self._curves.has("cross_track", "worst"):
                self._curves.start("cross_track", "worst", "furthest off", WORST, 2.5)
            self._curves.add("cross_track", "worst", newest, worst)

    def _ring(self, vehicle: str, label: str) -> None:
        self._recording.log(f"world/cars/{vehicle}/worst", ring(shown=bool(label)))
        label_entity = f"world/cars/{vehicle}/worst/name"
        self._recording.log(label_entity, ring_label(label, 0.6 * self._tag_m))

    def _log_line(self, line: LogText) -> None:
        level = _LEVELS.get(line.level, "INFO")
        self._log(line.vehicle, line.logged_at_ns, line.text, level)

    def _log(self, vehicle: str, at: int, text: str, level: str) -> None:
        """Log a text, one row per line: the viewer shows only the first line of a row."""
        self._set_time(at)
        at_s = (at - (self._start or 0)) / SECOND
        first, *others = textwrap.wrap(
            f"{at_s:8.2f} s  {vehicle}: {text}",
            LINE_LENGTH,
            subsequent_indent=" " * 12,
            drop_whitespace=True,
        )
        self._recording.log(f"log/{vehicle}", rr.TextLog(first, level=level))
        for other in others:
            self._recording.log(f"log/{vehicle}", rr.TextLog(other, level=""))

    def _change(self, change: Change) -> None:
        """Mark a change to a vehicle or its links, and log it as text."""
        vehicle, at = change.vehicle, change.effective_at_ns
        place = self._positions.get(vehicle)
        by = " by hand" if change.by_hand else ""
        self._log(vehicle, at, f"change{by}: {change.table}", "INFO")
        if place is not None:
            self.mark(Mark("change", at, place, (vehicle,), change.kind))

    def _log_road(self, path: Road, lane_m: float | None, spacing_m: float) -> None:
        road, marks = road_with_marks(*path, self._reach.tag_m)
        self._recording.log("world/road/path", road, static=True)
        self._recording.log("world/road/marks", marks, static=True)
        if lane_m is not None:
            self._recording.log("world/road/lane", lane_edges(*path, lane_m), static=True)
        if is_small(path, spacing_m):
            tag = name_tag(self._lead, colour_of(0), plan_tag_m(path))
            self._recording.log(f"world/cars/{self._lead}/plan_name", tag, static=True)

    def _place(self, vehicle: str) -> int:
        """Position of a vehicle in the convoy; an unannounced vehicle comes last."""
        place = self._places.get(vehicle)
        if place is None:
            known = vehicle in self._convoy
            place = self._convoy.index(vehicle) if known else len(self._places)
            self._places[vehicle] = place
            self._add_vehicle(vehicle, colour_of(place))
        return place

    def _add_vehicle(self, vehicle: str, colour: Colour) -> None:
        dot = rr.Points2D(
            [[0.0, 0.0]], colors=[colour], radii=rr.Radius.ui_points(5.0), draw_order=21
        )
        shapes = {
            f"cars/{vehicle}/body": car(self._cars.get(vehicle, DEFAULT_CAR), colour),
            f"cars/{vehicle}/dot": dot,
            f"driven/{vehicle}": line_style(colour, width=1.0, order=5),
            f"trajectory/{vehicle}": line_style(colour, width=1.5, order=23),
            f"samples/{vehicle}": point_style(width=3.0, order=24),
        }
        for entity, shape in shapes.items():
            self._recording.log(f"world/{entity}", shape, static=True)
        self._zoom_level = None  # so that its name is written

    def _vehicle_to_follow(self, at: int) -> str:
        """Vehicle that the view follows: the middle of the vehicles that send."""
        if at - self._last_pose_at.get(self._followed, self._start or 0) > SILENT_NS:
            sending = [name for name, last in self._last_pose_at.items() if at - last <= SILENT_NS]
            sending.sort(key=self._place)
            self._followed = sending[middle(len(sending))]
        return self._followed

    def _is_due(self, vehicle: str, entity: str, at: int, period_ns: int) -> bool:
        timer = self._timers.get((vehicle, entity))
        if timer is None:
            timer = self._timers[vehicle, entity] = Timer(period_ns)
        return timer.is_due(at)

    def _set_time(self, at: int) -> None:
        if at == self._time_at:
            return
        self._time_at = at
        since_start = np.timedelta64(at - (self._start or 0), "ns")
        self._recording.set_time(TIMELINE, duration=since_start)
        self._recording.set_time("time", timestamp=np.datetime64(at, "ns"))
