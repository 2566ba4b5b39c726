"""The typed summary of a run, printed as tables and written as `summary.json`.

Only `to_json` and `from_json` handle it as anything but these classes. Docstrings of
the fields document them, see `documented_fields`.
"""

import ast
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields
from inspect import getsource
from itertools import pairwise
from math import nan
from textwrap import dedent
from types import NoneType
from typing import Any, Literal, NamedTuple, get_args

from pydantic import TypeAdapter, ValidationError

from scenarios.definition.changes import LINK_CHANGES, change_from_json
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.plug_ins.table import RECORDED
from scenarios.definition.versions import current_stamp, installed_versions, plug_in_digests
from scenarios.results.files import json_text, plain
from scenarios.results.links import LinkSummary
from scenarios.results.reaction import ReactionSummary
from scenarios.results.record import RecordHole
from scenarios.results.run_event import RunEvent
from scenarios.results.string_figures import STRING_DOCS, StringFigures
from scenarios.results.tables import RunTables
from scenarios.results.vehicle_figures import VehicleSummary

# ---- Changes to a running convoy, scheduled or by hand, as the summary lists them


MOST_CHANGES = 1000
"""Changes listed in the summary; the log has them all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunChange:
    """A change that was carried out."""

    at_s: float
    """Time from which the change holds."""
    kind: str
    """Kind of [[change]]: link, cut, heal, gnss, stall, crash, join, leave or speed."""
    target: str
    """Vehicle that changed, or sender → receiver of the changed links (*: any); empty for the
    convoy."""
    for_s: float | None
    """Duration; null if the change has no end of its own."""
    by_hand: bool
    """Whether the change was made by hand rather than by the scenario."""
    vehicles: tuple[str, ...]
    """Vehicles that carried the change out."""


class MadeChange(NamedTuple):
    """A change at an instant (ns) as JSON, and the vehicles that carried it out."""

    at_ns: int
    table: str
    kind: str
    by_hand: bool
    vehicles: tuple[str, ...]


def made_changes(run: RunTables) -> list[MadeChange]:
    """Changes in order of time; equal ones of several vehicles at an instant are one."""
    by: dict[tuple[int, str], MadeChange] = {}
    tables = [(name, run.table(name, "change")) for name in run.names]
    rows = [
        (rows.order[row], int(rows.at_ns[row]), rows["table"][row], rows["kind"][row], hand, name)
        for name, rows in tables
        for row, hand in enumerate(rows["by_hand"].tolist())
    ]
    for _, at, table, kind, hand, name in sorted(rows):
        before = by[at, table].vehicles if (at, table) in by else ()
        names = before if name in before else (*before, name)
        by[at, table] = MadeChange(at, table, kind, hand, names)
    return [by[key] for key in sorted(by)]


def run_changes(run: RunTables) -> tuple[RunChange, ...]:
    """Changes as the summary lists them; one of a later version has no target."""
    listed = []
    for made in made_changes(run)[:MOST_CHANGES]:
        target, for_s = "", None
        with suppress(ScenarioError):  # of a later version
            change = change_from_json(made.table)
            for_s = getattr(change, "for_s", None)
            target = getattr(change, "vehicle", "")
            if isinstance(change, LINK_CHANGES):
                target = f"{change.sender} → {change.receiver}"
        listed.append(
            RunChange(
                at_s=run.seconds(made.at_ns),
                kind=made.kind,
                target=target,
                for_s=for_s,
                by_hand=made.by_hand,
                vehicles=made.vehicles,
            )
        )
    return tuple(listed)


# ---- Summary


SCHEMA = "convoy.summary/2"
ClockName = Literal["wall", "virtual"]


def refuse_newer(schema: str) -> None:
    """Raise ValueError for the schema of a newer version of the program."""
    name, _, number = schema.rpartition("/")
    known, _, newest = SCHEMA.rpartition("/")
    if name != known or not number.isdecimal() or int(number) > int(newest):
        raise ValueError(
            f"schema: given {schema!r}, allowed up to {SCHEMA}; read it with the version of the "
            "program that wrote it, or a newer one"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunIdentity:
    """Identity of a run: scenario, overrides, seed, clock, identifier, and versions.

    `title` names the scenario with its overrides.
    """

    schema: str = SCHEMA
    """Name and version of this format."""
    scenario: str
    """Name of the scenario."""
    title: str = ""
    """Name, seed, weight of the predecessor, loss, presets and overrides, which distinguish runs.
    The name of a scenario that does not ship is followed by a fingerprint of its content."""
    overrides: tuple[str, ...] = ()
    """Settings given by --set and --seed."""
    seed: int
    """Seed of the random numbers."""
    clock: ClockName
    """wall or virtual."""
    run_id: str
    """Identifier of the run. In virtual time: scenario, overrides and seed. In real time: a random
    text, which the recorder's messages carry."""
    versions: Mapping[str, str]
    """Installed version."""
    sources: str = ""
    """Digest of the program's sources. Equal versions with other sources are other programs."""
    plug_ins: Mapping[str, str] = field(default_factory=dict)
    """Digest of the module of each user-defined class."""

    @classmethod
    def here(cls, scenario: Scenario, clock: ClockName, run_id: str) -> "RunIdentity":
        """Identity of a run by the programs installed here."""
        return cls(
            scenario=scenario.name,
            title=scenario.title,
            overrides=scenario.overrides,
            seed=scenario.seed,
            clock=clock,
            run_id=run_id,
            versions=installed_versions(),
            sources=current_stamp().sources,
            plug_ins=plug_in_digests(scenario.plug_ins),
        )

    def values(self) -> dict[str, Any]:
        """All fields in one table, the versions by their packages' names."""
        own: dict[str, Any] = plain(self)
        versions = own.pop("versions")
        return {**own, **versions}

    def metadata(self) -> dict[str, str]:
        """Texts for the metadata of a log; a list or a table is JSON."""
        return {
            name: json.dumps(value) if isinstance(value, list | dict) else str(value)
            for name, value in self.values().items()
        }

    @classmethod
    def of_values(cls, values: Mapping[str, Any]) -> "RunIdentity":
        """Read the result of `values` or `metadata`; missing fields stay empty.

        Raises ValueError for those of a newer format, whose fields may have another meaning.
        """
        refuse_newer(str(values.get("schema", SCHEMA)))
        known = {entry.name for entry in fields(cls)}
        own = {name: value for name, value in values.items() if name in known}
        own |= {
            name: json.loads(own[name])
            for name in ("overrides", "plug_ins")
            if isinstance(own.get(name), str)
        }
        return cls(
            **{"scenario": "", "run_id": ""}
            | own
            | {
                "overrides": tuple(own.get("overrides", ())),
                "seed": int(own.get("seed", 0)),
                "clock": "virtual" if own.get("clock") == "virtual" else "wall",
                "versions": {name: str(values[name]) for name in values if name not in known},
            }
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitFigure:
    """Result of one limit of `[limits]`, per vehicle for a limit on vehicles."""

    limit: str
    """Key in [limits] of the scenario."""
    bound: float
    """Allowed value."""
    value: float | None
    """Value of the run; null if the action that a deadline requires did not happen."""
    vehicle: str = ""
    """Vehicle of the figure; empty for a count of events."""
    action: str = ""
    """Action that a deadline requires; else empty."""
    message: str = ""
    """How the limit was broken, or why it was not judged; empty if it was kept."""
    judged: bool = True
    """Whether the log holds what the limit judges, up to limits.holes_s_max; if not, the run has
    failed."""

    @property
    def broken(self) -> bool:
        return bool(self.message)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary:
    """Figures of a run; an empty `reason` means that it was completed."""

    identity: RunIdentity
    outcome: Literal["completed", "failed", "incomplete", "running"]
    """completed, failed, incomplete (the log lacks more than 1 % of the poses, and nothing else
    failed), or running (of a log that is still being written)."""
    outcome_line: str = ""
    """The outcome in one line, as printed at the end. "OK: ..." is a completed run without events,
    "FAILED: ..." begins with the reason, "INCOMPLETE: ..." with what is missing, "RUNNING: ..." is
    a run that still runs; any other line is
    of a completed run and begins with its worst incident."""
    reason: str
    """Why the run failed; empty if it was completed."""
    duration_s: float
    """Requested duration."""
    ran_s: float
    """Actual duration."""
    recorder_rejected_messages: Mapping[str, int]
    """Messages that the recorder refused, by reason."""
    vehicles: tuple[VehicleSummary, ...] = field(default=())
    links: tuple[LinkSummary, ...] = field(default=())
    events: tuple[RunEvent, ...] = field(default=())
    holes: tuple[RecordHole, ...] = field(default=())
    limits: tuple[LimitFigure, ...] = field(default=())
    changes: tuple[RunChange, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
    """Vehicles that refused 100, 1000, ... messages because of their time stamps; tyres beyond
    their linear range; messages that did not arrive; links that deviate from their request; more
    than 1 % late ticks."""
    log_faults: str = ""
    """Damage and holes of the log in one line, by `convoy report`; else empty."""


ENTRIES: Mapping[str, type] = {
    "vehicles[]": VehicleSummary,
    "vehicles[].string": StringFigures,
    "vehicles[].reaction": ReactionSummary,
    "links[]": LinkSummary,
    "events[]": RunEvent,
    "holes[]": RecordHole,
    "limits[]": LimitFigure,
    "changes[]": RunChange,
}
"""Types of the entries of the summary's lists and tables."""


def documented_fields() -> dict[str, dict[str, str]]:
    """Document the fields of `summary.json`, and of the entries of its lists and tables."""
    identity = field_docs(RunIdentity)
    version = identity.pop("versions")
    of_run = identity | dict.fromkeys(installed_versions(), version) | field_docs(RunSummary)
    docs = {key: field_docs(kind) for key, kind in ENTRIES.items() if kind is not StringFigures}
    return {"summary.json": of_run, **docs, "vehicles[].string": STRING_DOCS}


def field_docs(kind: type) -> dict[str, str]:
    """Map the fields of a dataclass to their docstrings, each in one line.

    Fields without a docstring are left out.
    """
    (definition,) = ast.parse(dedent(getsource(kind))).body
    if not isinstance(definition, ast.ClassDef):
        raise TypeError(f"{kind!r} is no class")
    docs = {}
    for statement, following in pairwise(definition.body):
        match statement, following:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str(text))):
                docs[name] = " ".join(text.split())
    return docs


_FIGURES = TypeAdapter(RunSummary)


def to_json(summary: RunSummary) -> str:
    """Content of `summary.json`, also attached to the log."""
    figures = plain(summary)
    del figures["identity"]
    return json_text(summary.identity.values() | figures)


def _filled(value: Any, kind: type) -> Any:
    """Restore NaN where JSON has null, and fill in figures that are missing.

    A missing figure is NaN or None, as its type allows, unless its class has a default.
    """
    if not isinstance(value, dict):
        return value
    filled = dict(value)
    for entry in fields(kind):
        if entry.name in filled:
            if filled[entry.name] is None and entry.type is float:
                filled[entry.name] = nan
        elif entry.default is MISSING and entry.default_factory is MISSING:
            if entry.type is float:
                filled[entry.name] = nan
            elif NoneType in get_args(entry.type):
                filled[entry.name] = None
    return filled


def from_json(text: str) -> RunSummary:
    """Read a `summary.json` of this version or a later one; raises ValueError."""
    values = json.loads(text)
    if not isinstance(values, dict):
        raise ValueError("a summary is a table")  # noqa: TRY004 - wrong content of a file
    values = _filled(values, RunSummary)
    for name, kind in (
        ("vehicles", VehicleSummary),
        ("links", LinkSummary),
        ("limits", LimitFigure),
    ):
        if isinstance(values.get(name), list):
            values[name] = [_filled(row, kind) for row in values[name]]
    own = {entry.name for entry in fields(RunSummary)}
    try:
        return _FIGURES.validate_python(
            {name: value for name, value in values.items() if name in own}
            | {
                "identity": RunIdentity.of_values({k: v for k, v in values.items() if k not in own})
            },
            context=RECORDED,
        )
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise ValueError(f"not a summary: {key}: {first['msg']}") from error
