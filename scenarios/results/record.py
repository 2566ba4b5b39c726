"""What the record of a run lacks: missing poses, decisions and verdicts, by their numbers."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import ceil
from typing import Literal, NamedTuple

import numpy as np
from pydantic import ValidationError

from scenarios.definition.changes import VEHICLE_CHANGES, is_changed
from scenarios.definition.schema.change_tables import CrashTable
from scenarios.results.tables import RunTables, once
from transport.columns import Columns, Flags, Integers
from vehicles.messages import Health
from vehicles.schedule import SECOND, instant, nanoseconds

HoleKind = Literal["pose", "true pose"]
RecordKind = Literal["true pose", "decision"]
"""Messages of which figures, events and limits are made."""
USUAL_RATE_HZ = 20.0
LONGEST_STEP = 1.5
"""Time, in control periods, between two decisions or true poses without a hole."""
SILENT_NS = SECOND
"""A vehicle without records for this time before the end had left; messages in transit at a stop
take less."""
AWAY_NS = SECOND
"""A vehicle whose pose reached the recorder later than this, or not at all, was away."""
CUT_OFF_AFTER_NS = 3 * SECOND
"""A vehicle whose last report is older when its token disappears did not end: it was cut off.

Vehicles report once a second. The token of a process that ends disappears at once, that of one that
is cut off or suspended after the lease of its session.
"""
FOREVER = 2**62
"""After every instant (ns)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordHole:
    """Consecutive poses of a vehicle that are due and missing in the log.

    `from_s` and `to_s` are the instants of the first and the last of them; without a schedule of
    sending those of the poses before and after. A hole of "true pose"s is one of the poses of which
    the figures are made, while other poses were recorded.
    """

    vehicle: str
    """Vehicle with a gap in the recording: poses were sent and not recorded. All figures are of
    recorded messages."""
    from_s: float
    """Instant of the first missing pose; without a schedule of sending, of the pose before."""
    to_s: float
    """Instant of the last missing pose; without a schedule, of the pose after."""
    poses: int
    """Number of missing poses."""
    kind: HoleKind = "pose"
    """pose; or true pose, where poses were recorded meanwhile."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenSpan:
    """Time in which nothing is known of a vehicle: messages of a kind are missing in the log.

    `from_s` and `to_s` are the instants of the messages before and after; `missing_s` is the time
    that the missing ones cover.
    """

    vehicle: str
    kind: RecordKind
    from_s: float
    to_s: float
    missing_s: float


# ---- Gaps in the numbers of messages


class Gap(NamedTuple):
    """First and last of consecutive missing numbers; instants (ns) of the messages around them."""

    first: int
    last: int
    before: int
    after: int

    @property
    def size(self) -> int:
        return self.last - self.first + 1


def gaps(messages: Columns, expected: int = 0, begin: int = 0, end: int = 0) -> list[Gap]:
    """Gaps in the numbers of messages, of which at least `expected` were sent.

    A gap before the first message begins at `begin` (ns), one after the last ends at `end` (ns).
    """
    numbers, at = messages["seq"], messages.at_ns
    newest = int(numbers[-1]) if len(numbers) else -1
    known = np.concatenate(([-1], numbers, [max(expected, newest + 1)]))
    instants = np.concatenate(([begin], at, [end]))
    rows = np.flatnonzero(np.diff(known) > 1)
    columns = known[rows] + 1, known[rows + 1] - 1, instants[rows], instants[rows + 1]
    return [Gap(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


def seen_before(run: RunTables, topic: str, vehicles: Iterable[str], at: int) -> int | None:
    """Earliest instant (ns) before a hole in which an event seen at `at` (ns) may have begun.

    None if the messages of `topic` of all `vehicles` were recorded just before.
    """
    return min(
        (
            gap.before
            for name in vehicles
            for gap in gaps(run.table(name, topic), begin=run.beginning)
            if gap.before < at <= gap.after
        ),
        default=None,
    )


# ---- What each vehicle should have sent


@once
def poses_of(run: RunTables, name: str) -> Columns:
    """Recorded poses of a vehicle, without those numbered ahead of its schedule."""
    poses = run.table(name, "gps")
    is_possible = possible(run, name, poses["seq"], poses.logged_at_ns)
    return poses if is_possible.all() else poses.of(is_possible)


def possible(run: RunTables, name: str, numbers: Integers, logged_at_ns: Integers) -> Flags:
    """Whether a vehicle can have sent poses of these numbers a second after the last was logged.

    Without the start of the run the first of the numbers counts as correct.
    """
    begin, first = run.start_at, 0
    if begin is None:
        begin, first = logged_at_ns.min(initial=FOREVER), numbers.min(initial=FOREVER)
    until_s = (logged_at_ns.max(initial=begin) - begin) / SECOND + 1.0
    most: Flags = numbers <= first + until_s * run.scenario.vehicle(name).highest_rate_hz
    return most & (numbers >= 0)


def last_health(run: RunTables, name: str) -> Health | None:
    """Last counters of a vehicle."""
    rows = run.table(name, "health").fields.items()
    values = {field: column[-1:].tolist() for field, column in rows}
    if not values["seq"]:
        return None
    return Health(vehicle=name, **{field: value for field, (value,) in values.items()})


@once
def final_health(run: RunTables, name: str) -> Health | None:
    """Final counters of a vehicle, None if it did not end as planned."""
    health = last_health(run, name)
    return health if health is not None and health.final else None


def pose_rate_hz(run: RunTables, name: str) -> float | None:
    """Rate of a vehicle that sends at every instant of measuring, else None."""
    tables, setup = run.scenario.tables, run.scenario.vehicle(name)
    if is_changed(tables.change, name) or name in tables.repeats_messages:
        return None
    if not VEHICLE_CHANGES.isdisjoint(run.table(name, "change")["kind"]):
        return None
    return setup.gnss.rate if setup.sends_every_instant else None


def ended_early(run: RunTables, name: str) -> bool:
    """Whether a vehicle reported a fatal error, or crashed for the rest of the run."""
    changes = run.table(name, "change")
    crashes = changes["table"][changes["kind"] == "crash"]
    is_fatal = bool((run.table(name, "log")["level"] == "fatal").any())
    return is_fatal or any(map(_is_for_good, crashes.tolist()))


def _is_for_good(table: str) -> bool:
    with suppress(ValidationError):  # messages from the bus may be malformed
        return CrashTable.model_validate_json(table).for_s is None
    return False


def planned_ns(run: RunTables) -> int:
    return nanoseconds(run.scenario.duration_s)


def silent_from_s(run: RunTables, name: str) -> float | None:
    """Time (s) after which nothing of a vehicle was recorded although the run went on."""
    last_at = run.last_at[name]
    if run.start_at is None:
        return None
    if not last_at:  # nothing of it was ever recorded
        return 0.0 if run.ran_ns >= planned_ns(run) else None
    until = max(last_at - run.start_at, 0)
    return until / SECOND if run.ran_ns - until > SILENT_NS else None


def ran_until(run: RunTables, name: str) -> int | None:
    """Time (ns) up to which the messages of a vehicle are due, None if that is unknown.

    If a vehicle without final counters was silent at the end of a complete run for a short time,
    it was cut off or its last messages are missing; one that was silent for longer may have failed.
    """
    health = last_health(run, name)
    if run.start_at is None or health is None or ended_early(run, name):
        return None
    if not health.final:
        is_silent = silent_from_s(run, name) is not None
        return None if is_silent or run.ran_ns < planned_ns(run) else run.ran_ns
    until = min(run.ran_ns, health.reported_at_ns - run.start_at)
    if until < planned_ns(run):  # stopped early: its last poses were not sent
        until -= SILENT_NS
    return until


def never_seen(run: RunTables, name: str) -> bool:
    """Whether a vehicle that did not end should have sent true poses, and none was recorded."""
    has_ended = ended_early(run, name) or final_health(run, name) is not None
    return run.start_at is not None and not has_ended and not len(run.table(name, "truth"))


def scheduled(run: RunTables, name: str, rate_hz: float | None, *, whole_run: bool = False) -> int:
    """Count the messages due at `rate_hz` until the end of a vehicle, or of the run.

    It is 0 if the end or the rate is unknown.
    """
    until = run.ran_ns if whole_run else ran_until(run, name)
    return 0 if until is None or rate_hz is None else expected_poses(until, rate_hz)


def expected_poses(until_ns: int, rate_hz: float) -> int:
    """Count the instants of a schedule of `rate_hz` in the first `until_ns` (ns)."""
    about = max(ceil(until_ns * rate_hz / SECOND) - 1, 0)  # an instant is rounded
    return about + sum(instant(0, k, rate_hz) < until_ns for k in range(about, about + 3))


# ---- Vehicles out of reach of the recorder


@once
def is_physical(run: RunTables) -> bool:
    """Whether poses took time to reach the recorder, as in no virtual run."""
    tables = [poses_of(run, name) for name in run.names]
    return any((poses.logged_at_ns != poses.at_ns).any() for poses in tables)


def is_late(poses: Columns) -> Flags:
    """Whether each pose reached the recorder later than AWAY_NS."""
    late: Flags = poses.logged_at_ns - poses.at_ns > AWAY_NS
    return late


@once
def end_of_record(run: RunTables) -> int:
    """Instant (ns) of the last message of any vehicle."""
    return max(run.last_at.values())


@once
def cut_off(run: RunTables) -> frozenset[str]:
    """Vehicles that were out of reach at the end of the record.

    In a convoy that continues without failed vehicles, a silent one may have failed.
    """
    if run.scenario.continues_without_failed or run.start_at is None or not is_physical(run):
        return frozenset()
    return frozenset(name for name in run.names if _was_cut_off(run, name, run.start_at))


def _was_cut_off(run: RunTables, name: str, start_at: int) -> bool:
    """Whether a vehicle became silent, or its last pose came late and its records lag."""
    end_at = end_of_record(run)
    if ended_early(run, name) or final_health(run, name) is not None:
        return False
    if end_at - max(run.last_at[name], start_at) > CUT_OFF_AFTER_NS:
        return True
    tables = run.table(name, "truth"), run.table(name, "tracking")
    known_until = max(int(table.at_ns[-1]) if len(table) else 0 for table in tables)
    late = is_late(poses_of(run, name))
    return bool(late[-1:].any()) and end_at - known_until > SECOND


# ---- Holes


def record_holes(run: RunTables) -> tuple[RecordHole, ...]:
    """Missing poses in order of time.

    A vehicle that became silent without final counters may have failed: no hole. A vehicle of which
    no true pose was recorded is a hole of the whole run, as is one without any pose.
    """
    found = []
    for name in run.names:
        holes = pose_holes(run, name)
        found += [*holes, *_true_holes(run, name, holes)]
    return tuple(sorted(found, key=lambda hole: hole.from_s))


def missing_poses(run: RunTables, name: str) -> int:
    """Count the missing poses; without a schedule those before the newest recorded one."""
    return sum(hole.poses for hole in pose_holes(run, name))


def pose_holes(run: RunTables, name: str) -> list[RecordHole]:
    """Holes in the poses of a vehicle, up to its end or that of the run."""
    poses, rate_hz = poses_of(run, name), pose_rate_hz(run, name)
    due = scheduled(run, name, rate_hz, whole_run=never_seen(run, name) and not len(poses))
    found = gaps(poses, due, begin=run.beginning)
    return [_hole(run, name, "pose", gap, rate_hz) for gap in found]


def _true_holes(run: RunTables, name: str, known: Sequence[RecordHole]) -> Iterator[RecordHole]:
    """Holes in the true poses of a vehicle outside of the `known` ones."""
    rate_hz = run.scenario.control_rate_hz
    slack_s = 1.0 / (pose_rate_hz(run, name) or USUAL_RATE_HZ)
    due = scheduled(run, name, rate_hz, whole_run=never_seen(run, name))
    for gap in gaps(run.table(name, "truth"), due):
        hole = _hole(run, name, "true pose", gap, rate_hz)
        if not any(
            other.from_s - slack_s <= hole.from_s and hole.to_s <= other.to_s + slack_s
            for other in known
        ):
            yield hole


def _hole(run: RunTables, name: str, kind: HoleKind, gap: Gap, rate_hz: float | None) -> RecordHole:
    """Hole between two instants of a schedule, or without one between the messages around it."""
    begin, end = gap.before - run.beginning, gap.after - run.beginning
    if rate_hz is not None:
        begin, end = instant(0, gap.first, rate_hz), instant(0, gap.last, rate_hz)
    return RecordHole(
        vehicle=name, from_s=begin / SECOND, to_s=end / SECOND, poses=gap.size, kind=kind
    )


def unseen(run: RunTables) -> tuple[UnseenSpan, ...]:
    """Times in which nothing is known of a vehicle, up to its end or that of the run."""
    return tuple(span for name in run.names for span in _unseen(run, name))


def _unseen(run: RunTables, name: str) -> Iterator[UnseenSpan]:
    start_at, truth = run.beginning, run.table(name, "truth")
    tables: Mapping[RecordKind, Columns] = {
        "true pose": truth,
        "decision": run.table(name, "tracking"),
    }
    spans: list[tuple[RecordKind, Gap, float]] = [
        (kind, gap, gap.size / (gap.size + 1) if gap.first else 1.0)
        for kind, table in tables.items()
        for gap in gaps(table, begin=start_at)
    ]
    last_at = int(truth.at_ns[-1]) if len(truth) else start_at
    health, until = last_health(run, name), ran_until(run, name)
    is_open = health is not None and not health.final and not ended_early(run, name)
    if (is_open and silent_from_s(run, name) is not None) or never_seen(run, name):
        until = run.ran_ns
    step = LONGEST_STEP * SECOND / run.scenario.control_rate_hz
    if until is not None and until - (last_at - start_at) > step:
        spans.append(("true pose", Gap(0, 0, last_at, start_at + until), 1.0))
    for kind, gap, share in spans:
        yield UnseenSpan(
            vehicle=name,
            kind=kind,
            from_s=(gap.before - start_at) / SECOND,
            to_s=(gap.after - start_at) / SECOND,
            missing_s=(gap.after - gap.before) / SECOND * share,
        )


def hole_lines(holes: Sequence[RecordHole], most: int) -> Iterator[str]:
    """Yield up to `most` lines about missing poses, one for equal holes of several vehicles."""
    alike: dict[tuple[float, float, int, HoleKind], list[str]] = {}
    for hole in holes:
        key = (hole.from_s, hole.to_s, hole.poses, hole.kind)
        alike.setdefault(key, []).append(hole.vehicle)
    for (begin, end, count, kind), vehicles in list(alike.items())[:most]:
        poses = f"1 {kind}" if count == 1 else f"{count} {kind}s"
        when = f"{begin:.2f}" if count == 1 else f"{begin:.2f} to {end:.2f}"
        each = "each " if len(vehicles) > 1 else ""
        yield f"not recorded: {poses} {each}of {', '.join(vehicles)}, {when} s after the start"
    if len(alike) > most:
        yield f"not recorded: {len(alike) - most} more holes, see the summary"
