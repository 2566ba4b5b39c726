"""The status of a running convoy, as its recorder reports it on request."""

import json
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from scenarios.definition.changes import changed_links
from scenarios.definition.scenario import Scenario
from scenarios.runs.live import LiveRun
from transport.bus.bus import Bus
from transport.columns import Columns
from transport.topics import RUN_SENDER, control_key, counts_as_loss
from vehicles.messages import SourceStatus, statuses_in
from vehicles.schedule import SECOND

RECENT_NS = 3 * SECOND
"""Time over which the loss of a link is computed: long enough for tens of messages."""


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
            return _READER.validate_json(text)
        except ValidationError as error:
            raise ValueError("no status of a run") from error


_READER = TypeAdapter(RunStatus)


class StatusBoard:
    """Answers requests for the status of a run; only the answer runs on another thread."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self._scenario = scenario
        self._run = run
        self._answer = b""
        self._changed: set[tuple[str, str]] = set()

    def serve(self, bus: Bus) -> None:
        """Answer requests; the answer is empty before the start."""
        bus.answer(control_key(RUN_SENDER), lambda _: self._answer)

    def update(self, live: LiveRun) -> None:
        self._answer = self.status(live).text.encode()

    def status(self, live: LiveRun) -> RunStatus:
        for name in live.values:
            for table in _rows_of(live.new_rows.get((name, "change")), "table"):
                links = changed_links(table, self._scenario.vehicle_names, self._scenario.links)
                self._changed |= {link for link in links if link[1] == name}
        return RunStatus(
            run=self._run,
            scenario=self._scenario.name,
            at_s=live.seconds,
            duration_s=self._scenario.duration_s,
            vehicles=tuple(_vehicle(live, name) for name in self._scenario.vehicle_names),
            links=tuple(self._link(live, *pair) for pair in self._scenario.links),
        )

    def _link(self, live: LiveRun, sender: str, receiver: str) -> LinkStatus:
        verdicts = live.window.table(receiver, "verdict")
        recent = verdicts.at_ns >= live.evaluated_until - RECENT_NS
        rows = verdicts.of(recent & (verdicts["sender"] == sender))
        reasons = rows["reason"][rows["outcome"] == "dropped"]
        lost = sum(map(counts_as_loss, reasons.tolist()))
        return LinkStatus(
            sender=sender,
            receiver=receiver,
            judged=len(rows),
            loss_ratio=lost / len(rows) if len(rows) else None,
            changed=(sender, receiver) in self._changed,
        )


def _rows_of(columns: Columns | None, field: str) -> list[Any]:
    return [] if columns is None else columns[field].tolist()


def _vehicle(live: LiveRun, name: str) -> VehicleStatus:
    values, tracking = live.values[name], live.window.table(name, "tracking")
    decision = tracking.of(np.arange(len(tracking))[-1:])
    has_any = bool(len(decision))
    follows = has_any and name != live.window.lead
    return VehicleStatus(
        name=name,
        mode=values.mode,
        hazard=bool(decision["hazard"][0]) if has_any else False,
        reason=str(decision["reason"][0]) if has_any else "",
        speed_mps=values.speed_mps if isfinite(values.speed_mps) else 0.0,
        true_error_m=_finite_or_none(values.error_m),
        true_gap_m=_finite_or_none(values.gap_m),
        known_m=_finite_or_none(decision["known_m"][0]) if has_any else None,
        lead=_source(decision, "lead") if follows else None,
        predecessor=_source(decision, "predecessor") if follows else None,
        others=_others(decision) if has_any else {},
    )


def _source(decision: Columns, source: str) -> ReportedSource:
    names = ("status", "age_s", "received_ratio", "known_m")
    return _state(*(decision[f"{source}_{name}"][0] for name in names))


def _state(
    status: SourceStatus, age_s: float, received_ratio: float, known_m: float
) -> ReportedSource:
    return ReportedSource(
        status=status,
        age_s=_finite_or_none(age_s),
        received_ratio=_finite_or_none(received_ratio),
        known_m=_finite_or_none(known_m),
    )


def _others(decision: Columns) -> dict[str, ReportedSource]:
    columns = [
        decision.lists[name].values.tolist()
        for name in ("other_age_s", "other_received_ratio", "other_known_m")
    ]
    statuses = statuses_in(decision["other_sources"][0])
    return {
        name: _state(status, *row)
        for (name, status), *row in zip(
            statuses.items(), *columns, strict=False
        )  # from the bus: may differ
    }


def _finite_or_none(value: float) -> float | None:
    """Return None for values that JSON does not know."""
    return float(value) if isfinite(value) else None
