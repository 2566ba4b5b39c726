"""Failures of the Zenoh bus: errors, killed processes, lost routers, messages at closing."""

import json
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Queue
from threading import Thread

import pytest
import zenoh

from tests.made.transport.bus import ReceivedMessages, connect, until
from transport.bus import zenoh_bus
from transport.bus.bus import BusError
from transport.bus.zenoh_bus import (
    Router,
    ZenohBus,
    configuration,
    open_bus,
    open_router,
    prepare_bus,
)
from transport.bus.zenoh_options import DEFAULTS, ZenohOptions


@pytest.fixture
def router() -> Iterator[Router]:
    with open_router(("tcp/127.0.0.1:0",)) as opened:
        yield opened


def join(router: Router, run: str = "") -> ZenohBus:
    return open_bus(ZenohOptions(connect=router.endpoints, run=run))


@contextmanager
def process(router: Router, *lines: str) -> Iterator[subprocess.Popen[str]]:
    """Run a member of the network as a process, which prints a line when it has joined."""
    code = "\n".join(
        [
            "import sys, time",
            "from transport.bus.zenoh_bus import ZenohOptions, open_bus",
            "with open_bus(ZenohOptions(connect=(sys.argv[1],))) as bus:",
            "    print('there', flush=True)",
            *(f"    {line}" for line in lines),
        ]
    )
    command = [sys.executable, "-c", code, router.endpoints[0]]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stdout is not None
            assert child.stdout.readline() == "there\n"
            yield child
        finally:
            child.kill()


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def test_a_member_starts_with_the_prepared_configuration(
    router: Router, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ZenohOptions(connect=router.endpoints, run="prepared")
    made: list[str] = []

    def noted(requested: ZenohOptions, defaults: Mapping[str, str]) -> zenoh.Config:
        made.append(requested.run)
        return configuration(requested, defaults)

    monkeypatch.setattr(zenoh_bus, "configuration", noted)
    prepare_bus(options)
    with open_bus(options) as bus:
        assert bus.connected()
    assert made == ["prepared"]


def assert_one_clear_line(error: BusError) -> None:
    text = str(error)
    assert "\n" not in text
    assert ".rs" not in text
    assert "Json5Err" not in text


def test_a_router_on_a_free_port_reports_it(router: Router) -> None:
    assert re.fullmatch(r"tcp/127\.0\.0\.1:[1-9]\d*", router.endpoints[0])
    assert not router.has_clients()
    with join(router):
        assert until(router.has_clients)


def test_a_port_that_is_taken(router: Router) -> None:
    with pytest.raises(BusError, match="in use") as caught:
        open_router(router.endpoints)
    assert_one_clear_line(caught.value)
    assert router.endpoints[0] in str(caught.value)


def test_no_router() -> None:
    endpoint, began = free_endpoint(), time.monotonic()
    with pytest.raises(BusError, match="is a router there") as caught:
        open_bus(ZenohOptions(connect=(endpoint,), connect_timeout_s=0.3))
    assert 0.2 < time.monotonic() - began < 2.0
    assert_one_clear_line(caught.value)
    assert endpoint in str(caught.value)


def test_wrong_credentials_are_not_a_missing_router(tmp_path: Path) -> None:
    users = tmp_path / "users.txt"
    users.write_text("v2:right\n")
    known = f'transport/auth/usrpwd:{{user:"router",password:"x",dictionary_file:"{users}"}}'
    endpoint = free_endpoint()
    with open_router((endpoint,), cfg=(known,)):
        for password, word in (("right", ""), ("wrong", "password of user .*v2"), ("", "password")):
            own = (
                (f'transport/auth/usrpwd:{{user:"v2",password:"{password}"}}',) if password else ()
            )
            options = ZenohOptions(connect=(endpoint,), connect_timeout_s=0.5, cfg=own)
            if not word:
                open_bus(options).close()
                continue
            with pytest.raises(BusError, match=word) as caught:
                open_bus(options)
            assert "is a router there" not in str(caught.value)
            assert_one_clear_line(caught.value)


class SlowCable:
    """A TCP connection to `endpoint` that delays each direction by `delay_s`."""

    def __init__(self, endpoint: str, delay_s: float) -> None:
        self._target = ("127.0.0.1", int(endpoint.rpartition(":")[2]))
        self._delay_s = delay_s
        self._server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._server.accept()
                far = socket.create_connection(self._target)
                for ends in ((near, far), (far, near)):
                    Thread(target=self._carry, args=ends, daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        pending: Queue[tuple[float, bytes]] = Queue()

        def deliver() -> None:
            with suppress(OSError):
                while True:
                    at, data = pending.get()
                    time.sleep(max(0.0, at - time.monotonic()))
                    sink.sendall(data)

        Thread(target=deliver, daemon=True).start()
        with suppress(OSError):
            while data := source.recv(65536):
                pending.put((time.monotonic() + self._delay_s, data))


ROUND_TRIPS_S = (0.4, 1.0, 2.0)


def test_processes_join_and_get_answers_over_long_round_trips(router: Router) -> None:
    """They join at the same time, to save time."""
    with join(router) as recorder, ThreadPoolExecutor() as pool:
        recorder.answer("convoy/@clock/run", lambda payload: payload + b"!")
        recorder.announce("recorder", "R", "print")

        def joins(round_trip_s: float) -> tuple[bytes, set[str]]:
            cable = SlowCable(router.endpoints[0], round_trip_s / 2.0)
            answers: list[bytes] = []
            with open_bus(ZenohOptions(connect=(cable.endpoint,), connect_timeout_s=10.0)) as bus:
                members = {member.name for member in bus.members()}
                bus.request("convoy/@clock/run", answers.append, 5.0, b"now")
                assert until(lambda: bool(answers))
            return answers[0], members

        assert list(pool.map(joins, ROUND_TRIPS_S)) == 3 * [(b"now!", {"R"})]


def test_a_client_waits_for_its_router() -> None:
    endpoint = free_endpoint()
    code = (
        "import sys; from transport.bus.zenoh_bus import *;"
        "open_bus(ZenohOptions(connect=(sys.argv[1],))).close()"
    )
    with subprocess.Popen([sys.executable, "-c", code, endpoint]) as child:
        time.sleep(0.5)
        assert child.poll() is None
        with open_router((endpoint,)):
            assert child.wait(5.0) == 0


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (ZenohOptions(), "router to connect to"),
        (ZenohOptions(connect=("127.0.0.1",)), "protocol"),
        (ZenohOptions(listen=("nonsense",)), "protocol"),
        (ZenohOptions(cfg=("no_such_thing/at_all:1",)), "unknown key"),
        (ZenohOptions(cfg=("mode",)), "KEY:VALUE"),
        (ZenohOptions(cfg=("mode:peer",)), "mode:peer"),
        (ZenohOptions(cfg=('mode:"driver"',)), "driver"),
        (ZenohOptions(config=Path("/no/such/file.json5")), "/no/such/file.json5"),
    ],
)
def test_wrong_options(options: ZenohOptions, word: str) -> None:
    with pytest.raises(BusError, match=word) as caught:
        open_bus(options)
    assert_one_clear_line(caught.value)


def setting(options: ZenohOptions, name: str) -> object:
    return json.loads(configuration(options, DEFAULTS).get_json(name))


def test_the_file_goes_over_defaults_flags_over_the_file_settings_over_all(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        "{mode: 'peer', scouting: {multicast: {enabled: true}},"
        " connect: {endpoints: ['tcp/10.0.0.1:7447']}}"
    )
    by_file = ZenohOptions(config=file)
    assert setting(by_file, "mode") == "peer"
    assert setting(by_file, "scouting/multicast/enabled") is True
    assert setting(by_file, "connect/endpoints") == ["tcp/10.0.0.1:7447"]
    assert setting(by_file, "transport/shared_memory/enabled") is False
    by_flags = ZenohOptions(config=file, mode="client", connect=("tcp/a:1",))
    assert setting(by_flags, "mode") == "client"
    assert setting(by_flags, "connect/endpoints") == ["tcp/a:1"]
    by_settings = ZenohOptions(connect=("tcp/a:1",), cfg=('connect/endpoints:["tcp/b:2"]',))
    assert setting(by_settings, "connect/endpoints") == ["tcp/b:2"]


def test_runs_of_two_names_are_isolated(router: Router) -> None:
    received, of_other, on_the_wire = ReceivedMessages(), ReceivedMessages(), ReceivedMessages()
    with (
        join(router, "one") as sender,
        join(router, "one") as receiver,
        join(router, "other") as stranger,
        join(router) as anyone,
    ):
        receiver.subscribe("convoy/**", received)
        stranger.subscribe("convoy/**", of_other)
        anyone.subscribe("**", on_the_wire)
        sender.announce("vehicle", "v1", "print")
        assert until(lambda: len(receiver.members()) == 1)
        assert stranger.members() == anyone.members() == set()
        connect(sender, received)
        sender.publish("convoy/v1/gps", b"1")
        assert until(lambda: ("one/convoy/v1/gps", b"1") in on_the_wire)
        assert received == [("convoy/v1/gps", b"1")]
        assert of_other == []


def test_a_message_has_its_encoding_and_priority(router: Router) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps(router.endpoints))
    samples: dict[str, zenoh.Sample] = {}
    with zenoh.open(config) as foreign, join(router) as bus:
        foreign.declare_subscriber("convoy/**", lambda s: samples.__setitem__(str(s.key_expr), s))

        def both() -> bool:
            bus.publish("convoy/lead/gps", b"1", urgent=True)
            bus.publish("convoy/lead/truth", b"2")
            return len(samples) == 2

        assert until(both)
    pose, truth = samples["convoy/lead/gps"], samples["convoy/lead/truth"]
    assert str(pose.encoding) == "application/protobuf;convoy.GpsPose"
    assert (pose.priority, pose.express) == (zenoh.Priority.DATA_HIGH, False)
    assert (truth.priority, truth.express) == (zenoh.Priority.DATA, False)
    assert truth.congestion_control == zenoh.CongestionControl.DROP


def test_publications_arrive_before_closing(router: Router) -> None:
    received = ReceivedMessages()
    with join(router) as receiver:
        receiver.subscribe("convoy/**", received)
        for burst in (1, 2000):
            received.clear()
            with process(
                router, f"for k in range({burst}): bus.publish('convoy/a/truth', b'%200d' % k)"
            ) as child:
                assert child.wait(10.0) == 0
            until(lambda burst=burst: len(received) >= burst)  # type: ignore[misc]
            assert [int(data) for _, data in received] == list(range(burst))


def test_a_failing_handler_does_not_end_its_subscription(
    router: Router, caplog: pytest.LogCaptureFixture
) -> None:
    received: list[bytes] = []

    def fail_once(_key: str, data: bytes) -> None:
        received.append(data)
        if len(received) == 1:
            raise RuntimeError("handler at fault")

    with caplog.at_level(logging.ERROR), join(router) as sender, join(router) as receiver:
        receiver.subscribe("convoy/*/log", fail_once)

        def twice() -> bool:
            sender.publish("convoy/a/log", b"x")
            return len(received) >= 2

        assert until(twice)
    assert "handler at fault" in caplog.text


@pytest.mark.parametrize(
    ("how", "seconds"), [(signal.SIGKILL, 1.0), (signal.SIGSTOP, 15.0)], ids=["killed", "frozen"]
)
def test_a_suspended_vehicle_is_reported(
    router: Router, how: signal.Signals, seconds: float
) -> None:
    alive: dict[str, bool] = {}
    announce = "bus.announce('vehicle', 'lead', 'print')"
    with join(router) as watcher, process(router, announce, "time.sleep(60)") as child:
        watcher.watch(lambda member, is_alive: alive.update({member.name: is_alive}))
        assert until(lambda: alive == {"lead": True})
        os.kill(child.pid, how)
        assert until(lambda: not alive["lead"], seconds)
        assert watcher.connected()


def test_a_router_frozen_for_four_seconds_loses_nothing_and_nobody() -> None:
    endpoint = free_endpoint()
    code = (
        "import sys, time; from transport.bus.zenoh_bus import *;"
        "router = open_router((sys.argv[1],)); time.sleep(60)"
    )
    received, gone = ReceivedMessages(), list[str]()
    options = ZenohOptions(connect=(endpoint,))
    with subprocess.Popen([sys.executable, "-c", code, endpoint]) as router:
        try:
            with open_bus(options) as vehicle, open_bus(options) as recorder:
                recorder.watch(lambda member, alive: None if alive else gone.append(member.name))
                recorder.subscribe("convoy/**", received)
                vehicle.announce("vehicle", "v1", "print")
                connect(vehicle, received)
                router.send_signal(signal.SIGSTOP)
                for number in range(80):
                    vehicle.publish("convoy/v1/gps", b"%d" % number)
                    time.sleep(0.05)
                router.send_signal(signal.SIGCONT)
                last = ("convoy/v1/gps", b"79")
                assert until(lambda: last in received)
                assert [d for k, d in received if k == last[0]] == [b"%d" % n for n in range(80)]
                assert gone == []
        finally:
            router.send_signal(signal.SIGCONT)
            router.kill()


def test_loss_of_the_router_is_no_failure_of_members() -> None:
    endpoint = free_endpoint()
    received = ReceivedMessages()
    changes: list[tuple[str, bool]] = []
    options = ZenohOptions(connect=(endpoint,))
    first = open_router((endpoint,))
    with first, open_bus(options) as vehicle, open_bus(options) as watcher:
        watcher.watch(lambda member, alive: changes.append((member.name, alive)))
        watcher.subscribe("convoy/*/log", received)
        vehicle.announce("vehicle", "lead", "print")
        connect(vehicle, received)
        assert until(lambda: changes == [("lead", True)])
        assert watcher.connected()

        first.close()
        assert until(lambda: len(changes) == 2)
        assert changes[1] == ("lead", False)
        assert until(lambda: not watcher.connected())
        began = time.monotonic()
        vehicle.publish("convoy/lead/log", b"unheard")
        assert time.monotonic() - began < 0.5

        with open_router((endpoint,)):
            assert until(lambda: len(changes) == 3 and watcher.connected())
            assert changes[2] == ("lead", True)
            connect(vehicle, received)
            vehicle.publish("convoy/lead/log", b"again")
            assert until(lambda: ("convoy/lead/log", b"again") in received)


def test_pauses_of_five_seconds_disconnect_nobody() -> None:
    assert setting(ZenohOptions(), "transport/link/tx/lease") == 10_000


def test_two_peers_need_no_router() -> None:
    endpoint, received = free_endpoint(), ReceivedMessages()
    with (
        open_bus(ZenohOptions(mode="peer", listen=(endpoint,))) as first,
        open_bus(ZenohOptions(mode="peer", connect=(endpoint,))) as other,
    ):
        first.subscribe("convoy/*/log", received)
        connect(other, received)
        other.publish("convoy/a/log", b"direct")
        assert until(lambda: received == [("convoy/a/log", b"direct")])
