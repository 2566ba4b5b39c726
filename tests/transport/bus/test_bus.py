"""Behaviour of every bus, memory and Zenoh."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count

import pytest

from tests.made.transport.bus import ReceivedMessages, connect, until
from transport.bus.bus import Bus, Member, MemoryBus, MemoryNetwork
from transport.bus.zenoh_bus import ZenohOptions, open_bus, open_router

Join = Callable[[], Bus]


@pytest.fixture(params=["memory", "zenoh"])
def join(request: pytest.FixtureRequest) -> Iterator[Join]:
    """Function that opens buses of one network."""
    with ExitStack() as stack:
        if request.param == "memory":
            network = MemoryNetwork()
            yield lambda: stack.enter_context(MemoryBus(network))
        else:
            router = stack.enter_context(open_router(("tcp/127.0.0.1:0",)))
            options = ZenohOptions(connect=router.endpoints)
            yield lambda: stack.enter_context(open_bus(options))


def test_messages_arrive_whole_and_in_order(join: Join) -> None:
    sender, receiver, received = join(), join(), ReceivedMessages()
    receiver.subscribe("convoy/*/log", received)
    connect(sender, received)
    sent = [("convoy/lead/log", bytes([k]) * k) for k in range(200)]
    for key, data in sent:
        sender.publish(key, data)
    assert until(lambda: len(received) >= len(sent))
    assert received == sent


def test_collected_messages_wait_until_fetched(join: Join) -> None:
    sender, receiver, received, fetched = join(), join(), ReceivedMessages(), ReceivedMessages()
    arrivals, clock = list[int](), count()

    def take(key: str, data: bytes, arrived_at: int) -> None:
        fetched(key, data)
        arrivals.append(arrived_at)

    fetch = receiver.collect("convoy/lead/gps", take, 50, lambda: next(clock))
    receiver.subscribe("convoy/lead/*", received)
    connect(sender, received, "convoy/lead/log")
    assert fetch() is False

    def send(count: int) -> list[tuple[str, bytes]]:
        sent = [("convoy/lead/gps", bytes([k])) for k in range(count)]
        received.clear()
        for key, data in sent:
            sender.publish(key, data)
        sender.publish("convoy/lead/other", b"")
        assert until(lambda: ("convoy/lead/other", b"") in received)
        time.sleep(0.05)
        return sent

    sent = send(49)
    assert fetched == []
    assert fetch() is False
    assert fetched == sent
    assert arrivals == list(range(49))  # read at the arrival, not when fetched
    assert fetch() is False
    fetched.clear()
    sent = send(80)
    assert fetch() is True  # the newest ones are kept
    assert fetched == sent[-50:]


def test_only_subscribed_keys_are_received(join: Join) -> None:
    sender, receiver, received, all_received = (
        join(),
        join(),
        ReceivedMessages(),
        ReceivedMessages(),
    )
    receiver.subscribe("convoy/*/gps", received)
    receiver.subscribe("convoy/**", all_received)
    connect(sender, all_received)
    for key in ("convoy/a/gps", "convoy/a/log", "convoy/b/gps", "other/a/gps", "convoy/a/b/gps"):
        sender.publish(key, b"1", urgent=False)
    end = ("convoy/end/gps", b"2")
    sender.publish(*end)
    # each subscription has its own thread
    assert until(lambda: end in received and end in all_received)
    assert {key for key, _ in received} == {"convoy/a/gps", "convoy/b/gps", end[0]}
    assert "other/a/gps" not in {key for key, _ in all_received}


def test_a_late_watcher_gets_the_members_alive(join: Join) -> None:
    vehicle, watcher = join(), join()
    alive: dict[Member, bool] = {}
    vehicle.announce("vehicle", "lead", "print")
    watcher.watch(alive.__setitem__)
    lead = Member("vehicle", "lead", "print", vehicle.zid)
    assert until(lambda: alive == {lead: True})
    assert join().members() == {lead}
    vehicle.close()
    assert until(lambda: join().members() == set())


def test_joining_and_leaving_are_reported_once_each(join: Join) -> None:
    vehicle, watcher = join(), join()
    changes: list[tuple[str, bool]] = []
    watcher.watch(lambda member, alive: changes.append((member.name, alive)))
    vehicle.announce("vehicle", "follower_1", "print")
    vehicle.announce("vehicle", "follower_1", "print")
    assert until(lambda: bool(changes))
    vehicle.close()
    assert until(lambda: len(changes) == 2)
    time.sleep(0.05)
    assert changes == [("follower_1", True), ("follower_1", False)]


def test_two_members_of_one_name_are_distinguished(join: Join) -> None:
    first, other, watcher = join(), join(), join()
    changes: list[tuple[str, bool]] = []
    first.announce("vehicle", "lead", "print")
    other.announce("recorder", "lead", "other")
    watcher.watch(lambda member, alive: changes.append((member.session, alive)))
    assert until(lambda: len(changes) == 2)
    first.close()
    assert until(lambda: changes[2:] == [(first.zid, False)])
    assert join().members() == {Member("recorder", "lead", "other", other.zid)}


def test_a_question_is_answered_as_long_as_someone_does(join: Join) -> None:
    first, other = join(), join()
    answer = b"1"
    assert other.query("convoy/@clock/v1", 0.2) is None
    first.answer("convoy/@clock/v1", lambda _: answer)
    assert until(lambda: other.query("convoy/@clock/v1", 0.5) == b"1")
    answer = b"2"
    assert other.query("convoy/@clock/v1", 0.5) == b"2"
    assert other.query("convoy/@clock/v2", 0.2) is None
    first.close()
    assert until(lambda: other.query("convoy/@clock/v1", 0.2) is None)


def test_a_closed_bus_receives_nothing(join: Join) -> None:
    sender, receiver, other, received, still = (
        join(),
        join(),
        join(),
        ReceivedMessages(),
        ReceivedMessages(),
    )
    receiver.subscribe("convoy/*/log", received)
    other.subscribe("convoy/*/log", still)
    connect(sender, still)
    connect(sender, received)
    receiver.close()
    receiver.close()
    received.clear()
    still.clear()
    sender.publish("convoy/lead/log", b"1")
    assert until(lambda: bool(still))
    assert not received
