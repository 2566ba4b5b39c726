"""The status of a running convoy, as its recorder reports it on request."""

import json
from collections import defaultdict, deque
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Any

from scenarios.definition.scenario import Scenario
from scenarios.results.metrics import Metrics
from transport.bus.bus import Bus
from transport.topics import RUN_SENDER, control_key, counts_as_loss
from vehicles.messages import LinkVerdict, Message, RunStart, SourceStatus, Tracking, TruePose
from vehicles.schedule import SECOND, Timer

RECENT_NS = 3 * SECOND
"""Time over which the loss of a link is computed: long enough for tens of messages."""
MOST_VERDICTS = 4096
OFTEN_NS = 5 * SECOND
"""How long after a request the status is updated at every call."""
RARELY_NS = SECOND
"""Largest age of the answer to a first request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedSource:
    """A source as its follower judges it; None for values that are not known."""

    status: SourceStatus
    age_s: float | None
    received_ratio: float | None
    known_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleStatus:
    """Current figures of one vehicle; None where there is nothing to measure.

    `others` are the sources that are neither lead nor predecessor, by name.
    """

    name: str
    mode: str
    hazard: bool
    reason: str
    speed_mps: float
    true_error_m: float | None
    true_gap_m: float | None
    known_m: float | None
    lead: ReportedSource | None
    predecessor: ReportedSource | None
    others: dict[str, ReportedSource] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkStatus:
    """Current figures of one link, with its loss over the last RECENT_NS.

    `changed`: its settings were changed during the run.
    """

    sender: str
    receiver: str
    judged: int
    loss_ratio: float | None
    changed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatus:
    """Status of a run `at_s` after its start."""

    run: str
    scenario: str
    at_s: float
    duration_s: float
    vehicles: tuple[VehicleStatus, ...] = ()
    links: tuple[LinkStatus, ...] = ()

    @property
    def text(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def of(cls, text: bytes) -> "RunStatus":
        """Parse a status; raises ValueError."""
        try:
            fields: dict[str, Any] = json.loads(text)
            vehicles = [
                VehicleStatus(
                    **{key: row[key] for key in row.keys() - {"lead", "predecessor", "others"}},
                    others={name: ReportedSource(**one) for name, one in row["others"].items()},
                    lead=ReportedSource(**row["lead"]) if row["lead"] else None,
                    predecessor=ReportedSource(**row["predecessor"])
                    if row["predecessor"]
                    else None,
                )
                for row in fields.pop("vehicles")
            ]
            links = tuple(LinkStatus(**row) for row in fields.pop("links"))
            return cls(**fields, vehicles=tuple(vehicles), links=links)
        except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
            raise ValueError("no status of a run") from error


class StatusBoard:
    """Observer that keeps the latest messages and answers requests for the status.

    Only the answer runs on another thread than the recorder's.
    """

    kinds: frozenset[type[Message]] = frozenset({LinkVerdict, RunStart, Tracking, TruePose})

    def __init__(self, scenario: Scenario, run: str, metrics: Metrics) -> None:
        self._scenario = scenario
        self._run = run
        self._metrics = metrics
        self._start_at: int | None = None
        self._now = 0
        self._tracking: dict[str, Tracking] = {}
        self._verdicts: defaultdict[tuple[str, str], deque[tuple[int, bool]]] = defaultdict(
            lambda: deque(maxlen=MOST_VERDICTS)
        )
        self._answer = b""
        self._requests = 0
        self._known_requests = 0
        self._updated_often_until = 0
        self._rare_update = Timer(RARELY_NS)

    def serve(self, bus: Bus) -> None:
        """Answer requests; the answer is empty before the start."""

        def answer(_: bytes) -> bytes:
            self._requests += 1
            return self._answer

        bus.answer(control_key(RUN_SENDER), answer)

    def listen(self, _at: int, message: Message) -> None:
        match message:
            case TruePose():
                self._now = max(self._now, message.true_at_ns)
            case Tracking():
                self._tracking[message.vehicle] = message
            case LinkVerdict():
                lost = message.outcome == "dropped" and counts_as_loss(message.reason)
                row = self._verdicts[message.sender, message.vehicle]
                row.append((message.received_at_ns, lost))
            case RunStart():
                self._start_at = message.start_at_ns

    def update(self, now: int) -> None:
        """Update the answer at instant `now` (ns): rarely, or at every call while requests come.

        An update takes milliseconds for a long convoy.
        """
        if self._requests != self._known_requests:
            self._known_requests, self._updated_often_until = self._requests, now + OFTEN_NS
        is_due = self._rare_update.is_due(now) or now < self._updated_often_until
        if self._start_at is not None and is_due:
            self._answer = self.status(self._start_at).text.encode()

    def status(self, start_at: int) -> RunStatus:
        return RunStatus(
            run=self._run,
            scenario=self._scenario.name,
            at_s=max(self._now - start_at, 0) / SECOND,
            duration_s=self._scenario.duration_s,
            vehicles=tuple(map(self._vehicle, self._scenario.vehicle_names)),
            links=tuple(self._link(*pair) for pair in self._scenario.links),
        )

    def _vehicle(self, name: str) -> VehicleStatus:
        figures, tracking = self._metrics.vehicles[name], self._tracking.get(name)
        gap = self._metrics.stream.gaps.get(name)
        true = figures.cross_track_error
        follows = tracking is not None and name != self._scenario.lead
        return VehicleStatus(
            name=name,
            mode=figures.mode,
            hazard=tracking.hazard if tracking else False,
            reason=tracking.reason if tracking else "",
            speed_mps=figures.speed,
            true_error_m=true.latest if true.count else None,
            true_gap_m=_finite_or_none(gap.now_m) if gap else None,
            known_m=_finite_or_none(tracking.known_m) if tracking else None,
            lead=_source(tracking, "lead") if tracking and follows else None,
            predecessor=_source(tracking, "predecessor") if tracking and follows else None,
            others=_others(tracking) if tracking else {},
        )

    def _link(self, sender: str, receiver: str) -> LinkStatus:
        row = self._verdicts[sender, receiver]
        while row and row[0][0] < self._now - RECENT_NS:
            row.popleft()
        lost = sum(lost for _, lost in row)
        return LinkStatus(
            sender=sender,
            receiver=receiver,
            judged=len(row),
            loss_ratio=lost / len(row) if row else None,
            changed=self._metrics.links[sender, receiver].changed,
        )


def _source(tracking: Tracking, source: str) -> ReportedSource:
    figures = ("status", "age_s", "received_ratio", "known_m")
    return _state(*(getattr(tracking, f"{source}_{figure}") for figure in figures))


def _state(
    status: SourceStatus, age_s: float, received_ratio: float, known_m: float
) -> ReportedSource:
    return ReportedSource(
        status=status,
        age_s=_finite_or_none(age_s),
        received_ratio=_finite_or_none(received_ratio),
        known_m=_finite_or_none(known_m),
    )


def _others(tracking: Tracking) -> dict[str, ReportedSource]:
    figures = (tracking.other_age_s, tracking.other_received_ratio, tracking.other_known_m)
    return {
        name: _state(status, *row)
        for (name, status), *row in zip(tracking.statuses().items(), *figures, strict=True)
    }


def _finite_or_none(value: float) -> float | None:
    """Return None for values that JSON does not know."""
    return value if isfinite(value) else None
