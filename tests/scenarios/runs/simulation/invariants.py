"""What must hold after every run, whatever its faults were."""

from collections.abc import Iterator
from functools import cache, cached_property
from typing import TypeVar

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.summary import RunSummary, from_json
from scenarios.runs.node.sink import BatchingSink
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_DONE
from scenarios.runs.virtual import VirtualConvoy
from tests.scenarios.runs.simulation.network import NetworkSettings
from tests.scenarios.runs.simulation.plan import FOREVER, LAUNCHER, RECORDER, ROUTER
from tests.scenarios.runs.simulation.world import Process, World, scenario_of
from transport.bus.telemetry import records_key, unpacked
from transport.codec import decode
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import RUN_SENDER, TOPICS, key
from vehicles.messages import Change, GpsPose, Health, LogText, Message, RunEnd, RunStart, TruePose
from vehicles.schedule import MILLISECOND, SECOND, nanoseconds

STOPPED_BY_LAUNCHER = {-9, 143}
M = TypeVar("M", bound=Message)
BASE_RATE_HZ = 10
SILENT_S = 1.0
"""Vehicles that end less than this before the others are not reported as silent."""
LOWEST_SLACK_NS = 12 * MILLISECOND
"""Interruptions and delays that no clock sees."""


class Aftermath:
    """What is left of a simulated run."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.plan = world.plan
        self.recorder = world.process(RECORDER)
        self.launcher = world.process(LAUNCHER)

    @cached_property
    def summary(self) -> RunSummary | None:
        path = self.world.folder / SUMMARY_NAME
        return from_json(path.read_text(encoding="utf-8")) if path.exists() else None

    @cached_property
    def log(self) -> LogReader | None:
        path = self.world.folder / LOG_NAME
        if not path.exists():
            return None
        try:
            return LogReader(path)
        except LogError:
            return None

    @cached_property
    def logged(self) -> list[tuple[int, str, Message]]:
        """Rare messages of the log."""
        if self.log is None:
            return []
        return list(self.log.messages({"start", "end", "log", "change"}))

    def of_kind(self, kind: type[M]) -> list[M]:
        return [message for _, _, message in self.logged if isinstance(message, kind)]

    @property
    def vehicles(self) -> Iterator[Process]:
        """Last process of each vehicle."""
        for name in self.plan.names:
            process = self.world.process(name)
            if process is not None:
                yield process

    @property
    def is_completed(self) -> bool:
        return self.summary is not None and self.summary.outcome == "completed"

    @cached_property
    def sent(self) -> dict[tuple[str, str], list[tuple[int, Message]]]:
        """Messages that vehicles sent, by vehicle and topic, with the true instants."""
        sent: dict[tuple[str, str], list[tuple[int, Message]]] = {}
        for name in self.plan.names:
            for topic in TOPICS.values():
                if topic.batched:
                    continue
                rows = self.world.network.published.get(key(name, topic), ())
                sent[name, topic.name] = [(at, decode(topic, data)) for at, data in rows]
            alone = self.world.network.published.get(key(name, TOPICS["truth"]), ())
            truths = [(at, decode(TOPICS["truth"], data)) for at, data in alone]
            for at, batch in self.world.network.published.get(records_key(name), ()):
                for topic_name, _, data in unpacked(batch):
                    if topic_name == "truth":
                        truths.append((at, decode(TOPICS["truth"], data)))
            sent[name, "truth"] = truths
        return sent

    def count_sent(self, vehicle: str, topic: str) -> int:
        return len({message.seq for _, message in self.sent[vehicle, topic]})

    def was_disturbed(self, process: Process) -> bool:
        """Whether a fault ended a process or its latest predecessor."""
        return any(each.is_faulty for each in self.world.processes if each.name == process.name)


def broken(run: Aftermath) -> list[str]:
    """Lines on what does not hold; empty after a good run."""

    return [line for check in CHECKS for line in check(run)]


def no_role_waits_for_ever(run: Aftermath) -> Iterator[str]:
    if not run.world.is_over:
        yield f"roles wait for ever: {run.world.stuck}"
    for role in run.world.scheduler.roles:
        if role.crash:
            yield f"{role.name} crashed: {role.crash}"


def every_failure_has_a_reason(run: Aftermath) -> Iterator[str]:
    for process in run.world.processes:
        is_stopped = process.is_faulty or process.stop.requested or process.name == ROUTER
        if process.exitcode in {1, 2} and not is_stopped:
            processes = run.world.processes if run.plan.launched else [process]
            lines = [line for each in processes for line in each.lines]
            errors = any(
                len(line) > len("error: ") and line.startswith("error: ") for line in lines
            )
            reported = run.summary is not None and bool(run.summary.reason)
            elsewhere = process.name in {RECORDER, LAUNCHER} or run.plan.launched
            if not errors and not (elsewhere and (reported or run.world.printed)):
                yield f"{process.name} failed without a reason"


def outcome_and_exit_codes_agree(run: Aftermath) -> Iterator[str]:
    summary = run.summary
    outcome = summary.outcome if summary is not None else "no summary"
    recorder = None if run.recorder is None else run.recorder.exitcode
    decides = recorder is not None and recorder >= 0 and recorder != EXIT_BAD_INPUT
    if decides and (recorder == EXIT_DONE) != run.is_completed:
        yield f"recorder ended with {recorder}, {outcome}"
    launcher = None if run.launcher is None or run.launcher.is_faulty else run.launcher.exitcode
    if launcher is not None and (launcher == EXIT_DONE) != run.is_completed:
        yield f"convoy run ended with {launcher}, {outcome}"
    for vehicle in run.vehicles:
        if run.was_disturbed(vehicle) or vehicle.joined_at is None:
            continue
        vehicle_code = vehicle.exitcode
        if run.plan.launched and vehicle_code in STOPPED_BY_LAUNCHER:
            continue
        is_named = _is_known_failed(run, vehicle.name) or (
            any("unknown end" in line for line in vehicle.lines)
            and (vehicle.name in unconfirmed(run) or recorder is None or recorder < 0)
        )
        if run.is_completed and vehicle_code != EXIT_DONE and not is_named:
            yield f"{vehicle.name} ended with {vehicle_code} in a completed run"
        if not run.is_completed and vehicle_code == EXIT_DONE and not run.plan.launched:
            yield f"{vehicle.name} ended with 0 in a failed run"


def unconfirmed(run: Aftermath) -> set[str]:
    """Vehicles that the recorder of a completed run reports as perhaps without knowledge of it."""
    lines = [line for line in run.world.printed if line.endswith("did not confirm the end")]
    return {name for name in run.plan.names for line in lines if name in line}


def _is_known_failed(run: Aftermath, name: str) -> bool:
    """Whether the log names a vehicle that failed or left, perhaps for a while."""
    texts = [message.text for message in run.of_kind(LogText) if message.vehicle == RUN_SENDER]
    return any(text.startswith(f"{name} ") and "continues without it" in text for text in texts)


def failed_vehicles_are_in_the_outcome(run: Aftermath) -> Iterator[str]:
    """A vehicle that took no part to the end is named where a user looks first."""
    if run.summary is None or not run.is_completed:
        return
    for vehicle in run.summary.vehicles:
        sent = len(run.sent[vehicle.name, "truth"])
        expected = BASE_RATE_HZ * (run.plan.duration_s - SILENT_S)
        if (
            sent < expected
            and vehicle.silent_from_s is None
            and "not recorded" not in run.summary.outcome_line
        ):
            yield f"{vehicle.name} sent {sent} true poses: {run.summary.outcome_line}"


def only_disturbed_vehicles_are_blamed(run: Aftermath) -> Iterator[str]:
    texts = [text.text for text in run.of_kind(LogText) if text.vehicle == RUN_SENDER]
    if run.summary is not None:
        texts.append(run.summary.reason)
    for text in texts:
        name, _, line = text.partition(" ")
        is_blame = line.startswith(("failed ", "was cut off"))
        if name in run.plan.names and is_blame and not _had_own_trouble(run, name):
            yield f"nothing happened to {name}: {text}"
    for process in run.vehicles:
        if process.name in unconfirmed(run) and not (
            process.name in run.world.network.disturbed
            or run.was_disturbed(process)
            or run.world.network.states["query lost"]
            or _recorder_was_lost(run)
        ):
            yield f"nothing happened to {process.name}: {run.world.printed}"


def _recorder_was_lost(run: Aftermath) -> bool:
    """Whether the recorder was cut off beyond its lease, so that it has left for all vehicles."""
    spans = [fault[3] for fault in run.plan.faults if fault[0] in CUTS and fault[2] == RECORDER]
    return any(span >= run.plan.network.lease for span in spans)


SURVIVED_NS = 4 * SECOND
"""A run survives it if recorder or router are away for this time."""


def _had_own_trouble(run: Aftermath, name: str) -> bool:
    """Whether something happened to a vehicle, not only to all by router or recorder."""
    processes = [process for process in run.world.processes if process.name == name]
    if any(process.is_faulty for process in processes):
        return True
    if name not in run.world.network.disturbed:
        return any(process.exitcode not in {EXIT_DONE, None} for process in processes)
    faults = run.plan.faults
    away = sum(fault[-1] or FOREVER for fault in faults if fault[0] in ROUTER_FAULTS)
    away += sum(fault[3] for fault in faults if fault[0] in CUTS and fault[2] == RECORDER)
    slowly_back = run.plan.network.retry > NetworkSettings().retry
    own = any(fault[0] in CUTS and fault[2] == name for fault in faults)
    return own or slowly_back or away > SURVIVED_NS


ROUTER_FAULTS, CUTS = {"freeze router", "restart router"}, {"cut", "pause"}


def accounts_balance(run: Aftermath) -> Iterator[str]:
    if run.summary is None:
        return
    for link in run.summary.links:
        parts = (
            link.delivered
            + sum(link.dropped.values())
            + sum(link.not_arrived.values())
            + link.in_flight
            + link.unrecorded
        )
        name = f"{link.sender} → {link.receiver}"
        if link.sent != parts and run.is_completed:
            yield f"{name}: sent {link.sent}, accounted {parts}"
        sent = run.count_sent(link.sender, "gps")
        sender = run.world.process(link.sender)
        whole = sender is not None and not run.was_disturbed(sender) and sender.exitcode == 0
        whole &= not _is_known_failed(run, link.sender)
        holes = any(hole.vehicle == link.sender for hole in run.summary.holes)
        if run.is_completed and whole and not holes and link.sent != sent:
            yield f"{name}: sent {sent}, the account knows {link.sent}"


def holes_are_named(run: Aftermath) -> Iterator[str]:
    if run.summary is None or run.log is None or not run.is_completed:
        return
    for name in run.plan.names:
        process = run.world.process(name)
        if process is None or run.was_disturbed(process) or process.exitcode != EXIT_DONE:
            continue
        if _is_known_failed(run, name):
            continue
        for topic in ("gps", "truth"):
            missing = run.count_sent(name, topic) - run.log.counts.get((name, topic), 0)
            named = sum(hole.poses for hole in run.summary.holes if hole.vehicle == name)
            if missing > 0 and not named:
                yield f"{missing} messages {topic} of {name} are missing, no hole is named"
            if missing > 0 and topic == "truth" and run.summary.limits:
                yield f"{missing} true poses of {name} are missing, and limits are kept"


def nothing_received_is_lost(run: Aftermath) -> Iterator[str]:
    """Poses that arrived at a recorder that ended by itself are in its log or refused."""
    recorder, log = run.recorder, run.log
    code = None if recorder is None else recorder.exitcode
    if code is None or code < 0 or run.summary is None:
        return
    if run.is_completed and (log is None or log.truncated or log.damage):
        yield "a completed run has no complete log"
    if log is None or (run.world.disk.has_failed and not run.is_completed):
        return
    ends = [at for at, _, message in run.logged if isinstance(message, RunEnd)]
    starts = run.of_kind(RunStart)
    if not ends or not starts:
        return
    refused = sum(run.summary.recorder_rejected_messages.values())
    clock = run.world.clock_of(RECORDER)
    for name in run.plan.names:
        address = key(name, TOPICS["gps"])
        arrived = {
            data for at, data in run.world.network.received[address] if clock.unix_at(at) < ends[0]
        }
        missing = len(arrived) - log.counts.get((name, "gps"), 0)
        if missing > refused:
            yield f"{missing} poses of {name} arrived and are not in the log"
        distinct = {data for _, data in run.world.network.received[address]}
        if log.counts.get((name, "gps"), 0) > len(distinct):
            yield f"poses of {name} are in the log twice"


def confirmed_changes_are_logged(run: Aftermath) -> Iterator[str]:
    if run.summary is None or not run.is_completed:
        return
    starts = run.of_kind(RunStart)
    logged = {(row.vehicle, row.kind, row.effective_at_ns) for row in run.of_kind(Change)}
    for request in run.world.requests:
        answers = [each.answer for each in request.answers or () if each.answer]
        instants = {answer.from_s for answer in answers if answer.does}
        if len(instants) > 1:
            yield f"{request.entry} takes effect at {instants}"
        for answer in answers:
            process = run.world.process(answer.vehicle)
            if not answer.does or process is None or run.was_disturbed(process):
                continue
            at = starts[0].start_at_ns + nanoseconds(answer.from_s)
            has_holes = any(hole.vehicle == answer.vehicle for hole in run.summary.holes)
            if (answer.vehicle, request.entry["kind"], at) not in logged and not has_holes:
                yield f"{request.entry}: confirmed by {answer.vehicle}, and not in the log"


def clocks_are_right(run: Aftermath) -> Iterator[str]:
    """In a completed run no vehicle drove by a wrong clock without a word."""
    summary = run.summary
    if summary is None or not run.is_completed:
        return
    allowed = run.world.scenario.clock_uncertainty_ns_max + LOWEST_SLACK_NS
    clock = run.world.clock_of(RECORDER)
    warned = [text.text for text in run.of_kind(LogText) if text.level == "alert"]
    for vehicle in summary.vehicles:
        sent = [
            (at, pose) for at, pose in run.sent[vehicle.name, "gps"] if isinstance(pose, GpsPose)
        ]
        if not sent or any(vehicle.name in text for text in warned):
            continue
        if _is_known_failed(run, vehicle.name):
            continue
        turn = stagger_ns(run.plan.variant, run.plan.vehicles, vehicle.name)
        error = min((clock.unix_at(at) - pose.sent_at_ns - turn for at, pose in sent), key=abs)
        if abs(error) > allowed and not vehicle.late_ticks:
            yield f"the clock of {vehicle.name} is off by {error / MILLISECOND:.1f} ms"


def an_undisturbed_run_equals_the_virtual_one(run: Aftermath) -> Iterator[str]:
    """Without anything that explains a difference, cars drive as in virtual time."""
    summary = run.summary
    if summary is None or not run.is_completed or run.world.requests:
        return
    explained = (
        any(vehicle.late_ticks for vehicle in summary.vehicles)
        or any(link.late or link.not_arrived or link.unrecorded for link in summary.links)
        or bool(summary.holes)
        or any(
            isinstance(health, Health) and health.late_messages
            for name in run.plan.names
            for _, health in run.sent[name, "health"]
        )
        or any(run.was_disturbed(vehicle) for vehicle in run.vehicles)
        or any(_is_known_failed(run, name) for name in run.plan.names)
    )
    if explained:
        return
    places = final_places(run.plan.variant, run.plan.vehicles, run.plan.duration_s)
    for name, place in places.items():
        poses = [pose for _, pose in run.sent[name, "truth"] if isinstance(pose, TruePose)]
        if not poses or _place(max(poses, key=lambda pose: pose.seq)) != place:
            yield f"{name} drives otherwise than in virtual time, and nothing explains it"


@cache
def stagger_ns(variant: tuple[str, ...], vehicles: int, name: str) -> int:
    return VehicleBuilder(scenario_of(variant, vehicles, 1.0), name).stagger_ns


Place = tuple[float, float, float, float]


def _place(pose: TruePose) -> Place:
    return pose.east_m, pose.north_m, pose.distance_m, pose.speed_mps


@cache
def final_places(variant: tuple[str, ...], vehicles: int, duration_s: float) -> dict[str, Place]:
    """Last true poses in virtual time."""
    scenario: Scenario = scenario_of(variant, vehicles, duration_s)
    convoy = VirtualConvoy(scenario)
    truths: dict[str, TruePose] = {}

    def note(address: str, data: bytes) -> None:
        name = address.split("/")[1]
        for topic, _, content in unpacked(data):
            if topic == "truth":
                pose = decode(TOPICS["truth"], content)
                assert isinstance(pose, TruePose)
                truths[name] = pose

    def note_one(address: str, data: bytes) -> None:
        pose = decode(TOPICS["truth"], data)
        assert isinstance(pose, TruePose)
        truths[address.split("/")[1]] = pose

    for name in scenario.vehicle_names:
        convoy.bus.subscribe(records_key(name), note)
        convoy.bus.subscribe(key(name, TOPICS["truth"]), note_one)
    sinks: list[BatchingSink] = []

    def sink(vehicle: str) -> BatchingSink:
        alone = ("truth",) if scenario.is_measured(vehicle) else ()
        sinks.append(BatchingSink(vehicle, convoy.bus, convoy.clock.now, unbatched=alone))
        return sinks[-1]

    convoy.build(sink)
    convoy.run()
    for each in sinks:
        each.flush_all()
    return {name: _place(pose) for name, pose in truths.items()}


CHECKS = (
    no_role_waits_for_ever,
    every_failure_has_a_reason,
    outcome_and_exit_codes_agree,
    failed_vehicles_are_in_the_outcome,
    only_disturbed_vehicles_are_blamed,
    accounts_balance,
    holes_are_named,
    nothing_received_is_lost,
    confirmed_changes_are_logged,
    clocks_are_right,
    an_undisturbed_run_equals_the_virtual_one,
)
