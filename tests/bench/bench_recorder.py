"""Whether the recorder keeps up: `python -m tests.bench.bench_recorder [--vehicles 100]`.

One process sends what the vehicles of `lane_change` would, at real time and over a router, as they
do: poses alone, the rest in batches. Their messages come from a run in virtual time, with instants
of their own. Counted is what the log then holds; beside the recorder's processor time stands that
of the bare MCAP writer, given the same bytes in this process. With 100 vehicles and 60 s the
virtual run takes minutes, and 1 GB of memory.
"""

import argparse
import gc
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from socket import socket
from typing import Any

import psutil
from mcap.writer import Writer

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.runs.node.sink import BATCH_NS, BusSink
from scenarios.runs.processes.clock_offset import serve_clock
from scenarios.runs.processes.membership import VEHICLE, Fingerprint
from scenarios.runs.virtual.virtual_convoy import VirtualConvoy
from tests.bench.bench_run import Row, plain_loop, print_rows, timed, used_s
from tests.system.logs import Run
from tests.system.processes import Process, start, until
from transport.bus.zenoh_bus import ZenohBus, ZenohOptions, open_bus
from transport.clock import WallClock
from transport.codec import PROTOBUF, decode
from transport.log.reader import LogReader
from transport.telemetry import BatchRecord, packed, records_key
from transport.topics import RUN_SENDER, TOPICS, Topic, key
from vehicles.messages import Health, Message, RunStart
from vehicles.schedule import SECOND

SHARE_OF_A_CORE, SETTLED_S = 1.0, 10.0
"""What the recorder may take, and when its memory has what every run needs."""
STEP_NS = SECOND // 100
"""How often the sender looks what is due."""
WATCH_S = 0.5
SPEED_MPS = 18.0
"""At this the road of `lane_change` is long enough for a minute."""


@dataclass(frozen=True, slots=True)
class Sent:
    """A message of the virtual run: when it is due after the start (ns), and its bytes."""

    due: int
    vehicle: str
    topic: Topic
    data: bytes


def traffic(scenario: Scenario) -> list[Sent]:
    """All that the vehicles of a scenario send, in the order in which it is due."""
    convoy = VirtualConvoy(scenario)
    begin = scenario.start_at_ns
    found: list[Sent] = []

    def note(topic: Topic, data: bytes, message: Message) -> None:
        found.append(Sent(convoy.clock.now() - begin, message.vehicle, topic, data))

    nodes = convoy.build(lambda vehicle: BusSink(vehicle, convoy.bus, note))
    convoy.run()
    for node in nodes.values():
        node.outbox.publish_health(convoy.clock.now(), final=True)
    return found


class Shifter:
    """Moves the instants inside a message's bytes."""

    def __init__(self, shift: int) -> None:
        """`shift` is by how much (ns)."""
        self._shift = shift
        self._instants = {
            topic.name: [
                field.name
                for field in PROTOBUF[topic.message].DESCRIPTOR.fields
                if field.name.endswith("_at_ns")
            ]
            for topic in TOPICS.values()
        }

    def moved(self, sent: Sent) -> BatchRecord:
        """The message, some time later."""
        parsed: Any = PROTOBUF[sent.topic.message].FromString(sent.data)
        for name in self._instants[sent.topic.name]:
            setattr(parsed, name, getattr(parsed, name) + self._shift)
        at = getattr(parsed, sent.topic.instant)
        return BatchRecord(sent.topic.name, at, parsed.SerializeToString())


class Sender:
    """Sends the traffic of all vehicles, each message when it is due."""

    def __init__(self, bus: ZenohBus, scenario: Scenario, sent: list[Sent]) -> None:
        """Take part in the run as every one of the vehicles."""
        self._bus = bus
        self._clock = WallClock()
        self._scenario = scenario
        self._sent = sent
        self._start_at = 0
        self._is_over = False
        bus.subscribe(key(RUN_SENDER, TOPICS["start"]), self._note_start)
        bus.subscribe(key(RUN_SENDER, TOPICS["end"]), self._note_end)
        chunk = Fingerprint.of(scenario).chunk
        for vehicle in scenario.vehicle_names:
            serve_clock(bus, vehicle, self._clock.now)
            bus.announce(VEHICLE, vehicle, chunk)

    def _note_start(self, _: str, data: bytes) -> None:
        start = decode(TOPICS["start"], data)
        if isinstance(start, RunStart):
            self._start_at = start.start_at_ns

    def _note_end(self, _key: str, _data: bytes) -> None:
        self._is_over = True

    def send_all(self) -> float:
        """Send everything; returns by how much the sender itself was late at most (s)."""
        assert until(lambda: self._start_at > 0), "the recorder does not start the run"
        shifter = Shifter(self._start_at - self._scenario.start_at_ns)
        waiting: dict[str, list[BatchRecord]] = {name: [] for name in self._scenario.vehicle_names}
        latest, step, place = 0, 0, 0
        gc.freeze()  # a look at a million messages takes a second
        gc.disable()
        turns = list(waiting)
        while place < len(self._sent):
            step += 1
            at = step * STEP_NS
            latest = max(latest, self._clock.wait_until(self._start_at + at))
            while place < len(self._sent) and self._sent[place].due <= at:
                self._take(self._sent[place], shifter, waiting)
                place += 1
            # The turns of the vehicles are spread over the time of a batch, as theirs are.
            steps = BATCH_NS // STEP_NS
            for vehicle in turns[step % steps :: steps]:
                self._flush(vehicle, waiting)
        for vehicle in turns:
            self._flush(vehicle, waiting)
        return latest / SECOND

    def _take(self, sent: Sent, shifter: Shifter, waiting: dict[str, list[BatchRecord]]) -> None:
        record = shifter.moved(sent)
        if sent.topic.batched:
            waiting[sent.vehicle].append(record)
            return
        if sent.topic.message is Health:  # its last words come after everything else
            self._flush(sent.vehicle, waiting)
        self._bus.publish(key(sent.vehicle, sent.topic), record.data, urgent=sent.topic.urgent)

    def _flush(self, vehicle: str, waiting: dict[str, list[BatchRecord]]) -> None:
        for batch in packed(waiting[vehicle]):
            self._bus.publish(records_key(vehicle), batch)
        waiting[vehicle].clear()

    def await_end(self) -> None:
        """Wait until the recorder has announced the end."""
        assert until(lambda: self._is_over), "the recorder does not end the run"


class Watch(threading.Thread):
    """Processor time and memory of the recorder and the router, while they live."""

    def __init__(self, recorder: psutil.Process, router: psutil.Process) -> None:
        super().__init__(daemon=True)
        self._recorder, self._router = recorder, router
        self._over = threading.Event()
        self.memory: list[tuple[float, int]] = []
        self.cpu_s: list[tuple[float, float, float]] = []

    def run(self) -> None:
        """Look now and then."""
        while not self._over.wait(WATCH_S):
            now = time.monotonic()
            self.memory.append((now, self._recorder.memory_info().rss))
            self.cpu_s.append((now, used_s(self._recorder), used_s(self._router)))

    def finish(self) -> None:
        """Look no more."""
        self._over.set()
        self.join()


def bare_writer_s(sent: list[Sent]) -> float:
    """Processor time (s) of the MCAP writer alone for the same bytes."""
    writer = Writer(BytesIO())
    writer.start("", "bench")
    schema = writer.register_schema("bytes", "protobuf", b"")
    channels: dict[tuple[str, str], int] = {}
    for one in sent:
        name = one.vehicle, one.topic.name
        if name not in channels:
            channels[name] = writer.register_channel("/".join(name), "protobuf", schema)

    def write() -> None:
        for number, one in enumerate(sent):
            name = one.vehicle, one.topic.name
            writer.add_message(channels[name], one.due, one.data, one.due, number)
        writer.finish()  # type: ignore[no-untyped-call]

    return timed(write).processor_s


def lost(folder: Path, sent: list[Sent]) -> Counter[tuple[str, str]]:
    """Messages that were sent and are not in the log, by vehicle and topic."""
    held = Counter(LogReader(folder / LOG_NAME).counts)
    return Counter((one.vehicle, one.topic.name) for one in sent) - held


def rows(folder: Path, sent: list[Sent], watch: Watch, late_s: float) -> Iterator[Row]:
    """Rows about a recording."""
    run = Run(folder)
    missing = lost(folder, sent).total()
    refused = sum(run.summary["recorder_rejected_messages"].values())
    yield Row("messages sent", f"{len(sent)}")
    yield Row("not in the log, refused", f"{missing}, {refused}", "0, 0", missing == refused == 0)
    yield Row("sender late, ms", f"{late_s * 1000:.0f} at most")
    (begun, first, router_first), (ended, last, router_last) = watch.cpu_s[0], watch.cpu_s[-1]
    span = ended - begun
    share = (last - first) / span
    yield Row(
        "recorder, % of a core",
        f"{share * 100:.0f}",
        f"{SHARE_OF_A_CORE * 100:.0f}",
        share < SHARE_OF_A_CORE,
    )
    yield Row("router, % of a core", f"{(router_last - router_first) / span * 100:.0f}")
    each = (last - first) / len(sent)
    bare = bare_writer_s(sent)
    yield Row("  for each message, µs", f"{each * 1e6:.1f}")
    yield Row(
        "  times the bare MCAP writer's",
        f"{(last - first) / bare:.1f} (that takes {bare / len(sent) * 1e6:.2f} µs a message)",
    )
    loop = min(timed(plain_loop).wall_s for _ in range(3))
    yield Row("  plain loop of 10 million additions, s", f"{loop:.2f}")
    settled = [size for at, size in watch.memory if at > begun + min(SETTLED_S, span / 2)]
    yield Row(
        "recorder's memory, MB",
        f"{max(settled) / 1e6:.0f} at most, {(settled[-1] - settled[0]) / 1e6:+.0f} in "
        f"{span - min(SETTLED_S, span / 2):.0f} s",
    )


def record(folder: Path, scenario: Scenario, asked: list[str], sent: list[Sent]) -> list[Row]:
    """Record the traffic in `folder`; returns the rows of the table."""
    with socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with ExitStack() as stack:
        router = stack.enter_context(start("router", "-l", endpoint, folder=folder))
        out = folder / "run"
        recorder = stack.enter_context(
            start("record", scenario.name, *asked, "-e", endpoint, "--out", out, folder=folder)
        )
        options = ZenohOptions(connect=(endpoint,), run=scenario.name)
        bus = stack.enter_context(open_bus(options))
        sender = Sender(bus, scenario, sent)
        recorder.await_start()
        watch = Watch(_of(recorder), _of(router))
        watch.start()
        late_s = sender.send_all()
        watch.finish()
        sender.await_end()
        if recorder.wait() != 0:
            raise SystemExit(recorder.err)
    return list(rows(out, sent, watch, late_s))


def _of(process: Process) -> psutil.Process:
    return psutil.Process(process.popen.pid)


def main() -> None:
    parser = argparse.ArgumentParser(description="Whether the recorder keeps up.")
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long they drive")
    given = parser.parse_args()
    asked = [
        f"--set=convoy.vehicles={given.vehicles}",
        f"--set=duration_s={given.seconds:g}",
        f"--set=speed.set_mps={SPEED_MPS}",
    ]
    scenario = load_scenario("lane_change", [one.removeprefix("--set=") for one in asked])
    sent = traffic(scenario)
    with tempfile.TemporaryDirectory() as name:
        found = record(Path(name), scenario, asked, sent)
    print_rows(f"the recorder of {given.vehicles} vehicles for {given.seconds:g} s", found)


if __name__ == "__main__":
    main()
