"""Load of the recorder: `python -m tests.bench.logs.bench_recorder [--vehicles 100]`.

One process sends the messages of all vehicles of `lane_change` in real time over a router, as the
vehicles do: poses singly, other messages in batches. The messages come from a virtual run, with
shifted instants. Messages in the log are counted, and the recorder's processor time is compared to
that of the bare MCAP writer for the same bytes. For 100 vehicles and 60 s the virtual run takes
minutes, and 1 GB of memory.
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
from scenarios.runs.processes.membership import VEHICLE, ClockOffset, Fingerprint
from scenarios.runs.virtual import VirtualConvoy
from tests.bench.bench_run import Row, plain_loop, print_rows, timed, used_s
from tests.system.logs import Run
from tests.system.processes import Process, start, until
from transport.bus.telemetry import BatchRecord, packed, records_key
from transport.bus.zenoh_bus import ZenohBus, ZenohOptions, open_bus
from transport.clock import WallClock
from transport.codec import PROTOBUF, decode
from transport.log.reader import LogReader
from transport.topics import RUN_SENDER, TOPICS, Topic, clock_key, key
from vehicles.messages import Health, Message, RunStart
from vehicles.schedule import SECOND

SHARE_OF_A_CORE, SETTLED_S = 1.0, 10.0
"""Limit of the recorder's processor share, and time until its memory has settled."""
STEP_NS = SECOND // 100
"""Period of the sender."""
WATCH_S = 0.5
SPEED_MPS = 18.0
"""Slow enough for one minute on the road of `lane_change`."""


@dataclass(frozen=True, slots=True)
class Sent:
    """A message of the virtual run; `due` is in ns after the start."""

    due: int
    vehicle: str
    topic: Topic
    data: bytes


def traffic(scenario: Scenario) -> list[Sent]:
    convoy = VirtualConvoy(scenario)
    begin = scenario.start_at_ns
    result: list[Sent] = []

    def keep(topic: Topic, data: bytes, message: Message) -> None:
        result.append(Sent(convoy.clock.now() - begin, message.vehicle, topic, data))

    nodes = convoy.build(lambda vehicle: BusSink(vehicle, convoy.bus, keep))
    convoy.run()
    for node in nodes.values():
        node.outbox.publish_health(convoy.clock.now(), final=True)
    return result


class Shifter:
    """Shifts the instants of encoded messages by `shift` (ns)."""

    def __init__(self, shift: int) -> None:
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
        parsed: Any = PROTOBUF[sent.topic.message].FromString(sent.data)
        for name in self._instants[sent.topic.name]:
            setattr(parsed, name, getattr(parsed, name) + self._shift)
        at = getattr(parsed, sent.topic.instant)
        return BatchRecord(sent.topic.name, at, parsed.SerializeToString())


class Sender:
    def __init__(self, bus: ZenohBus, scenario: Scenario, sent: list[Sent]) -> None:
        self._bus = bus
        self._clock = WallClock()
        self._scenario = scenario
        self._sent = sent
        self._start_at = 0
        self._ended = False
        bus.subscribe(key(RUN_SENDER, TOPICS["start"]), self._on_start)
        bus.subscribe(key(RUN_SENDER, TOPICS["end"]), self._on_end)
        chunk = Fingerprint.of(scenario).chunk
        for vehicle in scenario.vehicle_names:
            bus.announce(VEHICLE, vehicle, chunk)

    def _on_start(self, _: str, data: bytes) -> None:
        start = decode(TOPICS["start"], data)
        if isinstance(start, RunStart):
            self._start_at = start.start_at_ns

    def _on_end(self, _key: str, _data: bytes) -> None:
        self._ended = True

    def _has_started(self) -> bool:
        for vehicle in self._scenario.vehicle_names:
            report = ClockOffset(vehicle, 0, 0).pack()
            self._bus.request(clock_key(RUN_SENDER), lambda _: None, 1.0, report)
        return self._start_at > 0

    def send_all(self) -> float:
        """Send all messages; return the largest delay (s) of the sender."""
        assert until(self._has_started), "the recorder does not start the run"
        shifter = Shifter(self._start_at - self._scenario.start_at_ns)
        batches: dict[str, list[BatchRecord]] = {name: [] for name in self._scenario.vehicle_names}
        latest, step, position = 0, 0, 0
        gc.freeze()  # scanning a million messages takes a second
        gc.disable()
        vehicles = list(batches)
        while position < len(self._sent):
            step += 1
            at = step * STEP_NS
            latest = max(latest, self._clock.wait_until(self._start_at + at))
            while position < len(self._sent) and self._sent[position].due <= at:
                self._take(self._sent[position], shifter, batches)
                position += 1
            # Batches of the vehicles are spread over the batch period, as in a run.
            steps = BATCH_NS // STEP_NS
            for vehicle in vehicles[step % steps :: steps]:
                self._flush(vehicle, batches)
        for vehicle in vehicles:
            self._flush(vehicle, batches)
        return latest / SECOND

    def _take(self, sent: Sent, shifter: Shifter, batches: dict[str, list[BatchRecord]]) -> None:
        record = shifter.moved(sent)
        if sent.topic.batched:
            batches[sent.vehicle].append(record)
            return
        if sent.topic.message is Health:  # the final counters come last
            self._flush(sent.vehicle, batches)
        self._bus.publish(key(sent.vehicle, sent.topic), record.data, urgent=sent.topic.urgent)

    def _flush(self, vehicle: str, batches: dict[str, list[BatchRecord]]) -> None:
        for batch in packed(batches[vehicle]):
            self._bus.publish(records_key(vehicle), batch)
        batches[vehicle].clear()

    def await_end(self) -> None:
        assert until(lambda: self._ended), "the recorder does not end the run"


class Watch(threading.Thread):
    def __init__(self, recorder: psutil.Process, router: psutil.Process) -> None:
        super().__init__(daemon=True)
        self._recorder, self._router = recorder, router
        self._over = threading.Event()
        self.memory: list[tuple[float, int]] = []
        self.cpu_s: list[tuple[float, float, float]] = []

    def run(self) -> None:
        while not self._over.wait(WATCH_S):
            now = time.monotonic()
            self.memory.append((now, self._recorder.memory_info().rss))
            self.cpu_s.append((now, used_s(self._recorder), used_s(self._router)))

    def finish(self) -> None:
        self._over.set()
        self.join()


def bare_writer_s(sent: list[Sent]) -> float:
    """Processor time (s) of the MCAP writer alone for the same bytes."""
    writer = Writer(BytesIO())
    writer.start("", "bench")
    schema = writer.register_schema("bytes", "protobuf", b"")
    channels: dict[tuple[str, str], int] = {}
    for message in sent:
        name = message.vehicle, message.topic.name
        if name not in channels:
            channels[name] = writer.register_channel("/".join(name), "protobuf", schema)

    def write() -> None:
        for number, message in enumerate(sent):
            name = message.vehicle, message.topic.name
            writer.add_message(channels[name], message.due, message.data, message.due, number)
        writer.finish()  # type: ignore[no-untyped-call]

    return timed(write).processor_s


def lost(folder: Path, sent: list[Sent]) -> Counter[tuple[str, str]]:
    held = Counter(LogReader(folder / LOG_NAME).counts)
    return Counter((message.vehicle, message.topic.name) for message in sent) - held


def rows(folder: Path, sent: list[Sent], watch: Watch, late_s: float) -> Iterator[Row]:
    run = Run(folder)
    missing = lost(folder, sent).total()
    refused = sum(run.summary["recorder_rejected_messages"].values())
    yield Row("messages sent", f"{len(sent)}")
    yield Row("not in the log, refused", f"{missing}, {refused}", "0, 0", missing == refused == 0)
    yield Row("sender late, ms", f"{late_s * 1000:.0f} at most")
    (first_at, first, router_first), (last_at, last, router_last) = watch.cpu_s[0], watch.cpu_s[-1]
    span = last_at - first_at
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
        f"{(last - first) / bare:.1f} (writer: {bare / len(sent) * 1e6:.2f} µs a message)",
    )
    loop = min(timed(plain_loop).wall_s for _ in range(3))
    yield Row("  plain loop of 10 million additions, s", f"{loop:.2f}")
    settled = [size for at, size in watch.memory if at > first_at + min(SETTLED_S, span / 2)]
    yield Row(
        "recorder's memory, MB",
        f"{max(settled) / 1e6:.0f} at most, {(settled[-1] - settled[0]) / 1e6:+.0f} in "
        f"{span - min(SETTLED_S, span / 2):.0f} s",
    )


def record(folder: Path, scenario: Scenario, settings: list[str], sent: list[Sent]) -> list[Row]:
    with socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with ExitStack() as stack:
        router = stack.enter_context(start("router", "-l", endpoint, folder=folder))
        out = folder / "run"
        recorder = stack.enter_context(
            start("record", scenario.name, *settings, "-e", endpoint, "--out", out, folder=folder)
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
    parser = argparse.ArgumentParser(description="Load of the recorder.")
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long they drive")
    given = parser.parse_args()
    settings = [
        f"--set=convoy.vehicles={given.vehicles}",
        f"--set=duration_s={given.seconds:g}",
        f"--set=speed.set_mps={SPEED_MPS}",
    ]
    scenario = load_scenario(
        "lane_change", [setting.removeprefix("--set=") for setting in settings]
    )
    sent = traffic(scenario)
    with tempfile.TemporaryDirectory() as name:
        result = record(Path(name), scenario, settings, sent)
    print_rows(f"the recorder of {given.vehicles} vehicles for {given.seconds:g} s", result)


if __name__ == "__main__":
    main()
