"""Knowledge of a vehicle at an instant of a recorded run, and why messages were missing."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any, cast

import numpy as np

from scenarios.definition.channel.build import origin
from scenarios.results.link_account import CAUSE_WORDS, LinkAccount, accounts
from scenarios.results.log_summary import scenario_in, tables_in
from scenarios.results.reaction import NOT_RELIED_ON
from scenarios.results.tables import RunTables
from transport.columns import Columns, Floats, Integers
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import counts_as_loss
from vehicles.driver.controller import RELIED_ON
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import OVERRIDES, Override, statuses_in
from vehicles.schedule import SECOND

IN_TRANSIT, NOT_ARRIVED, NOT_RECORDED = "in transit", "not arrived", "not recorded"
"""Fates of messages without a drop: not due yet, without a verdict, or with one that the log
lacks."""
FATES = {"in_flight": IN_TRANSIT, "unrecorded": NOT_RECORDED}
"""Fates of the account of a link; the others are causes why a message did not arrive."""
MOST_OFF_PATH_M = 20.0
"""Largest distance of a vehicle from the path that it follows."""
LEAST_MPS2 = 0.05
"""Least acceleration that is stated."""
SHOWN = 8
"""Missing messages listed individually."""


# ---- What is reported, and its sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingMessage:
    """A message sent after the newest received one of its sender, and why it is missing.

    `fate` is a drop reason, IN_TRANSIT, NOT_ARRIVED or NOT_RECORDED.
    """

    number: int
    sent_at_s: float
    fate: str
    cause: str
    due_at_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownSource:
    """What a vehicle knew of one sender; None before its first message.

    Instants are from the start. `path_left_m` is the distance from the vehicle's true position
    along the received positions of the sender to the newest of them, 0 if that lies behind.
    `received_ratio` is the delivered share of the messages due within the last second. `use` is the
    direction of control that uses the sender: lateral, longitudinal, or both.
    """

    sender: str
    use: str
    number: int | None = None
    measured_at_s: float | None = None
    received_at_s: float | None = None
    age_s: float | None = None
    path_left_m: float | None = None
    received_ratio: float | None
    missing: tuple[MissingMessage, ...]
    status: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """What `vehicle` knew at its last decision until the requested instant.

    `steered_along` are the senders along whose path it steers in its mode.
    `acceleration_mps2` is commanded, `law_acceleration_mps2` that of the longitudinal law, and
    `override` why they differ; None where the log lacks the command. `log_faults` describes damage
    and holes of the log in one line.
    """

    vehicle: str
    decided_at_s: float
    mode: str
    reason: str
    acceleration_mps2: float | None = None
    law_acceleration_mps2: float | None = None
    override: str = ""
    sources: tuple[KnownSource, ...]
    steered_along: tuple[str, ...] = ()
    log_faults: str = ""

    @property
    def sentence(self) -> str:
        """What the vehicle did, the known path per source, and the later messages per source."""
        sources = f"the path of {joined_words(self.steered_along)}"
        action = {
            "path": "drove its own path",
            "straight": "drove straight, as it had received nothing",
            "coast": "extrapolated its last trajectory",
            "stop": f"braked to a stop along {sources}",
        }.get(self.mode, f"followed {sources}")
        if self.mode == "composite" and len(self.steered_along) > 1:
            action = f"followed {sources.replace('path', 'composite trajectory', 1)}"
        parts = [f"At {self.decided_at_s:.2f} s {self.vehicle} {action}.", *self._speed_control()]
        ahead = [source for source in self.sources if source.use != "longitudinal"]
        unused = [_not_relied_on(source) for source in ahead if source.status in NOT_RELIED_ON]
        if unused:
            parts.append(f"Not relied on: {', '.join(unused)}.")
        if ahead:
            parts.append(f"Known path ahead: {', '.join(map(_known_path, ahead))}.")
        parts += [
            f"Later messages of {source.sender}: {counts_of(source.missing)}."
            for source in self.sources
            if source.missing
        ]
        return " ".join(parts)

    def _speed_control(self) -> Iterator[str]:
        """State the commanded acceleration and, if it is not that of the law, why."""
        commanded, law = self.acceleration_mps2, self.law_acceleration_mps2
        if commanded is None or law is None or (abs(commanded) < LEAST_MPS2 and not self.override):
            return
        verb = "braked" if commanded < 0.0 else "accelerated"
        text = f"It {verb} at {abs(commanded):.1f} m/s²"
        if not self.override:
            yield f"{text}, as its longitudinal law requested."
            return
        words = OVERRIDES.get(cast("Override", self.override), "")
        evidence = f" ({self.reason})" if self.reason else ""
        yield (
            f"{text} where its longitudinal law requested {law:+.1f} m/s²; overridden by "
            f"{self.override!r}: {words}{evidence}."
        )


def _not_relied_on(source: KnownSource) -> str:
    status = "on probation after a loss" if source.status == "probation" else source.status
    return f"{source.sender} ({status})"


def _known_path(source: KnownSource) -> str:
    if source.age_s is None:
        return f"{source.sender} none (nothing received)"
    return f"{source.sender} {source.path_left_m or 0.0:.1f} m (pose {source.age_s:.2f} s old)"


def fate_of(message: MissingMessage) -> str:
    """Fate of a message in words, without the cause."""
    if message.fate in {IN_TRANSIT, NOT_ARRIVED, NOT_RECORDED}:
        return message.fate
    return "lost" if counts_as_loss(message.fate) else "skipped"


def cause_of(message: MissingMessage) -> str:
    """Text of the cause if a message was dropped or did not arrive, else empty."""
    return "link cut" if message.cause == "cut" else message.cause


def counts_of(messages: Sequence[MissingMessage]) -> str:
    """Count messages by fate; dropped ones with their causes."""
    parts = []
    for fate, count in Counter(map(fate_of, messages)).items():
        causes = dict.fromkeys(cause_of(one) for one in messages if fate_of(one) == fate)
        reasons = joined_words([cause for cause in causes if cause])
        parts.append(f"{count} {fate}{f' ({reasons})' if reasons else ''}")
    return ", ".join(parts)


def joined_words(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


# ---- From the tables of a run


def explain(log: Path, vehicle: str, at_s: float) -> Explanation:
    """List what `vehicle` knew `at_s` (s) after the start of the run in `log`.

    Raises LogError for an unknown vehicle or an instant outside of the run.
    """
    reader = LogReader(log)
    scenario = scenario_in(reader)
    if vehicle not in scenario.vehicle_names:
        names = ", ".join(scenario.vehicle_names)
        raise LogError(f"{log}: no vehicle {vehicle!r}, allowed {names}")
    reader.require_all("verdict", "tracking", "truth")
    run = tables_in(reader, scenario)
    decided_at = run.table(vehicle, "tracking").at_ns
    if not len(decided_at):
        raise LogError(f"{log}: no decisions of {vehicle}")
    if not isfinite(at_s) or not decided_at[0] <= _instant(run, at_s) <= reader.last_at:
        first, last = run.seconds(decided_at[0]), run.seconds(decided_at[-1])
        raise LogError(
            f"{log}: {vehicle} has no decision at {at_s:g} s, allowed {first:g} to {last:g}"
        )
    return replace(explanation(run, vehicle, at_s), log_faults=reader.faults)


def _instant(run: RunTables, at_s: float) -> int:
    return run.beginning + round(at_s * SECOND)


def explanation(run: RunTables, vehicle: str, at_s: float) -> Explanation:
    """What a vehicle knew at its last decision until `at_s` (s) after the start."""
    tracking, command = run.table(vehicle, "tracking"), run.table(vehicle, "command")
    setup = run.scenario.vehicle(vehicle)
    row = int(np.searchsorted(tracking.at_ns, _instant(run, at_s), side="right")) - 1
    now, mode = int(tracking.at_ns[row]), tracking["mode"][row]
    statuses = {
        setup.predecessor or "": tracking["predecessor_status"][row],
        setup.lead: tracking["lead_status"][row],
        **statuses_in(tracking["other_sources"][row]),
    }
    commands = command.of(command.at_ns == now)
    commanded, law, override = (
        (commands[field].tolist() or [None])[0]
        for field in ("acceleration_mps2", "law_acceleration_mps2", "override")
    )
    return Explanation(
        vehicle=vehicle,
        decided_at_s=run.seconds(now),
        mode=mode,
        reason=tracking["reason"][row],
        acceleration_mps2=commanded,
        law_acceleration_mps2=law if law is not None and isfinite(law) else None,
        override=override or "",
        steered_along=_steered_along(run, vehicle, mode, statuses),
        sources=tuple(
            _known(run, accounts(run)[name, vehicle], now, statuses.get(name, ""))
            for name in setup.senders
        ),
    )


def _steered_along(
    run: RunTables, vehicle: str, mode: str, statuses: Mapping[str, str]
) -> tuple[str, ...]:
    """Lateral sources along whose path a vehicle steers; a composite leaves lost ones out."""
    setup = run.scenario.vehicle(vehicle)
    lateral, ends = setup.flow.lateral, (setup.lead, setup.predecessor or "")
    if mode in {"lead", "predecessor"}:
        return (ends[mode == "predecessor"],)
    if mode == "intermediate":
        lateral = tuple(name for name in lateral if name not in ends)
    kept = [name for name in lateral if statuses.get(name, "") in RELIED_ON]
    return tuple(kept) if mode in {"composite", "intermediate"} and kept else lateral


def _known(run: RunTables, account: LinkAccount, now: int, status: str) -> KnownSource:
    sender, vehicle = account.link
    verdicts, poses = account.verdicts, run.table(sender, "gps")
    due_at = verdicts["received_at_ns"]
    received = verdicts.of(account.is_delivered & (due_at <= now))
    since, newest = -1, dict[str, Any]()
    if len(received):
        row = int(np.argmax(received["measured_at_ns"]))
        since, measured_at = int(received["pose_seq"][row]), int(received["measured_at_ns"][row])
        clock = run.scenario.clock(vehicle, run.beginning)
        newest = {
            "number": since,
            "measured_at_s": run.seconds(measured_at),
            "received_at_s": run.seconds(received["received_at_ns"][row]),
            "age_s": (clock.reading(now) - measured_at) / SECOND,
            "path_left_m": _path_left(run, account, received["pose_seq"], now),
        }
    sent = poses.of((poses.at_ns <= now) & (poses["seq"] > since))
    is_due = (now - SECOND < due_at) & (due_at <= now)
    lost_at = account.missing.sent_at[account.missing.is_lost]  # due when they were sent
    due = int(is_due.sum() + ((now - SECOND < lost_at) & (lost_at <= now)).sum())
    return KnownSource(
        sender=sender,
        use=run.scenario.vehicle(vehicle).flow.use_of(sender),
        received_ratio=int(account.is_delivered[is_due].sum()) / due if due else None,
        missing=tuple(_missing(run, account, sent)),
        status=status,
        **newest,
    )


def _missing(run: RunTables, account: LinkAccount, sent: Columns) -> Iterator[MissingMessage]:
    """Yield `sent` poses that had not been received, each with its fate."""
    verdicts, (numbers, _, fates, _) = account.verdicts, account.missing
    judged = {number: row for row, number in enumerate(verdicts["pose_seq"].tolist())}
    without = dict(zip(numbers.tolist(), fates.tolist(), strict=True))
    for number, sent_at in zip(sent["seq"].tolist(), sent.at_ns.tolist(), strict=True):
        due_at_s, row = None, judged.get(number)
        if row is None:
            known = without.get(number, "")
            fate, cause = FATES.get(known, NOT_ARRIVED), CAUSE_WORDS.get(known, "")
        else:
            due_at_s, fate, cause = run.seconds(verdicts["received_at_ns"][row]), IN_TRANSIT, ""
            if not account.is_delivered[row]:
                fate = verdicts["reason"][row]
                cause = origin(run.scenario.tables, account.link, fate)
        sent_at_s = run.seconds(sent_at)
        yield MissingMessage(
            number=number, sent_at_s=sent_at_s, fate=fate, cause=cause, due_at_s=due_at_s
        )


def _path_left(run: RunTables, account: LinkAccount, numbers: Integers, now: int) -> float | None:
    """Distance (m) along the received positions of a sender that lies ahead of the vehicle."""
    sender, vehicle = account.link
    truth, poses = run.table(vehicle, "truth"), run.table(sender, "gps")
    here, plane = truth.of(truth.at_ns == now), LocalPlane(run.scenario.origin)
    if not len(here):
        return None
    known = poses.of(np.isin(poses["seq"], numbers))
    known = known.of(np.argsort(known["measured_at_ns"], kind="stable"))
    fields = ("latitude_deg", "longitude_deg", "altitude_m")
    points = zip(*(known[field].tolist() for field in fields), strict=True)
    places = np.array([plane.to_plane(*point) for point in points]).reshape(-1, 2)
    return remaining_path_length(places, np.array([here["east_m"][0], here["north_m"][0]]))


def remaining_path_length(places: Floats, here: Floats) -> float:
    """Length (m) of a polyline of `places` (N, 2) from the foot of `here` on it to its end.

    The foot is the nearest point of the last stretch that passes by: from the end backwards, the
    first at which the distance grows again within MOST_OFF_PATH_M.
    """
    if not len(places):
        return 0.0
    ends = places[::-1]
    steps = np.diff(ends, axis=0)
    length = np.hypot(*steps.T)
    along = np.sum((here - ends[:-1]) * steps, axis=1) / np.where(length > 0.0, length**2, 1.0)
    share = np.clip(along, 0.0, 1.0)
    feet = np.concatenate((ends[:1], ends[:-1] + share[:, None] * steps))
    distance = np.hypot(*(here - feet).T)
    nearest = np.minimum.accumulate(distance)[:-1]
    has_passed = (nearest < MOST_OFF_PATH_M) & (distance[1:] > nearest + MOST_OFF_PATH_M)
    stretch = distance[: int(np.argmax(has_passed)) + 1] if has_passed.any() else distance
    foot = len(stretch) - 1 - int(np.argmin(stretch[::-1]))
    return float(np.append(0.0, np.cumsum(length) - (1.0 - share) * length)[foot])
