"""What every bus does, over memory and over Zenoh alike."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from tests.made.transport.bus import Heard, connect, until
from transport.bus.bus import Bus, Member
from transport.bus.memory_bus import MemoryBus, MemoryNetwork
from transport.bus.zenoh_bus import ZenohOptions, open_bus, open_router

Join = Callable[[], Bus]


@pytest.fixture(params=["memory", "zenoh"])
def join(request: pytest.FixtureRequest) -> Iterator[Join]:
    """Return a way to join one network, as often as one likes."""
    with ExitStack() as stack:
        if request.param == "memory":
            network = MemoryNetwork()
            yield lambda: stack.enter_context(MemoryBus(network))
        else:
            router = stack.enter_context(open_router(("tcp/127.0.0.1:0",)))
            options = ZenohOptions(connect=router.endpoints)
            yield lambda: stack.enter_context(open_bus(options))


def test_messages_arrive_whole_and_in_order(join: Join) -> None:
    sender, receiver, heard = join(), join(), Heard()
    receiver.subscribe("convoy/*/log", heard)
    connect(sender, heard)
    sent = [("convoy/lead/log", bytes([k]) * k) for k in range(200)]
    for key, data in sent:
        sender.publish(key, data)
    assert until(lambda: len(heard) >= len(sent))
    assert heard == sent


def test_what_is_collected_waits_until_it_is_fetched(join: Join) -> None:
    sender, receiver, heard, fetched = join(), join(), Heard(), Heard()
    fetch = receiver.collect("convoy/lead/gps", fetched, 50)
    receiver.subscribe("convoy/lead/*", heard)
    connect(sender, heard, "convoy/lead/log")
    assert fetch() is False

    def send(count: int) -> list[tuple[str, bytes]]:
        sent = [("convoy/lead/gps", bytes([k])) for k in range(count)]
        heard.clear()
        for key, data in sent:
            sender.publish(key, data)
        sender.publish("convoy/lead/other", b"")
        assert until(lambda: ("convoy/lead/other", b"") in heard)
        time.sleep(0.05)
        return sent

    sent = send(49)
    assert fetched == []
    assert fetch() is False
    assert fetched == sent
    assert fetch() is False
    fetched.clear()
    sent = send(80)
    assert fetch() is True  # the newest are kept
    assert fetched == sent[-50:]


def test_only_what_was_subscribed_to_is_heard(join: Join) -> None:
    sender, receiver, heard, all_heard = join(), join(), Heard(), Heard()
    receiver.subscribe("convoy/*/gps", heard)
    receiver.subscribe("convoy/**", all_heard)
    connect(sender, all_heard)
    for key in ("convoy/a/gps", "convoy/a/log", "convoy/b/gps", "other/a/gps", "convoy/a/b/gps"):
        sender.publish(key, b"1", urgent=False)
    end = ("convoy/end/gps", b"2")
    sender.publish(*end)
    # each subscription is served by a thread of its own: the end is awaited at both
    assert until(lambda: end in heard and end in all_heard)
    assert {key for key, _ in heard} == {"convoy/a/gps", "convoy/b/gps", end[0]}
    assert "other/a/gps" not in {key for key, _ in all_heard}


def test_urgent_messages_arrive_too(join: Join) -> None:
    sender, receiver, heard = join(), join(), Heard()
    receiver.subscribe("convoy/*/gps", heard)
    connect(sender, heard, "convoy/x/gps")
    sender.publish("convoy/lead/gps", b"now", urgent=True)
    assert until(lambda: heard == [("convoy/lead/gps", b"now")])


def test_two_subscriptions_are_both_served(join: Join) -> None:
    sender, receiver, one, other = join(), join(), Heard(), Heard()
    receiver.subscribe("convoy/*/log", one)
    receiver.subscribe("convoy/lead/log", other)
    connect(sender, one)
    sender.publish("convoy/lead/log", b"1")
    assert until(lambda: len(one) == len(other) == 1)


def test_who_comes_late_learns_who_is_alive(join: Join) -> None:
    vehicle, watcher = join(), join()
    alive: dict[Member, bool] = {}
    vehicle.announce("vehicle", "lead", "print")
    watcher.watch(alive.__setitem__)
    lead = Member("vehicle", "lead", "print", vehicle.zid)
    assert until(lambda: alive == {lead: True})
    assert join().members() == {lead}
    vehicle.close()
    assert until(lambda: join().members() == set())


def test_coming_and_going_is_told_once_each(join: Join) -> None:
    vehicle, watcher = join(), join()
    told: list[tuple[str, bool]] = []
    watcher.watch(lambda member, alive: told.append((member.name, alive)))
    vehicle.announce("vehicle", "follower_1", "print")
    vehicle.announce("vehicle", "follower_1", "print")
    assert until(lambda: bool(told))
    vehicle.close()
    assert until(lambda: len(told) == 2)
    time.sleep(0.05)
    assert told == [("follower_1", True), ("follower_1", False)]


def test_two_of_one_name_are_told_apart(join: Join) -> None:
    one, other, watcher = join(), join(), join()
    told: list[tuple[str, bool]] = []
    one.announce("vehicle", "lead", "print")
    other.announce("recorder", "lead", "other")
    watcher.watch(lambda member, alive: told.append((member.session, alive)))
    assert until(lambda: len(told) == 2)
    one.close()
    assert until(lambda: told[2:] == [(one.zid, False)])
    assert join().members() == {Member("recorder", "lead", "other", other.zid)}


def test_a_question_is_answered_as_long_as_someone_does(join: Join) -> None:
    one, other = join(), join()
    answer = b"1"
    assert other.query("convoy/@clock/v1", 0.2) is None
    one.answer("convoy/@clock/v1", lambda _: answer)
    assert until(lambda: other.query("convoy/@clock/v1", 0.5) == b"1")
    answer = b"2"
    assert other.query("convoy/@clock/v1", 0.5) == b"2"
    assert other.query("convoy/@clock/v2", 0.2) is None
    one.close()
    assert until(lambda: other.query("convoy/@clock/v1", 0.2) is None)


def test_an_answer_is_to_what_was_asked(join: Join) -> None:
    one, other = join(), join()
    one.answer("convoy/@control/v1", lambda question: question[::-1])
    assert until(lambda: other.query("convoy/@control/v1", 0.5, b"ab") == b"ba")
    for question in (bytes(range(256)), b"x" * 100_000, b""):
        assert other.query("convoy/@control/v1", 2.0, question) == question[::-1]


def test_a_question_that_cannot_be_answered_is_not_the_last_one() -> None:
    with ExitStack() as stack:
        router = stack.enter_context(open_router(("tcp/127.0.0.1:0",)))
        options = ZenohOptions(connect=router.endpoints)
        one, other = (stack.enter_context(open_bus(options)) for _ in range(2))
        one.answer("convoy/@control/v1", lambda question: str(1 // len(question)).encode())
        assert until(lambda: other.query("convoy/@control/v1", 0.5, b"?") == b"1")
        assert other.query("convoy/@control/v1", 0.5) is None
        assert other.query("convoy/@control/v1", 0.5, b"?") == b"1"


def test_liveliness_is_not_a_message(join: Join) -> None:
    vehicle, watcher, heard = join(), join(), Heard()
    watcher.subscribe("convoy/**", heard)
    connect(vehicle, heard)
    vehicle.announce("vehicle", "lead", "print")
    vehicle.publish("convoy/lead/log", b"after")
    assert until(lambda: bool(heard))
    assert heard == [("convoy/lead/log", b"after")]


def test_a_closed_bus_hears_no_more(join: Join) -> None:
    sender, receiver, other, heard, still = join(), join(), join(), Heard(), Heard()
    receiver.subscribe("convoy/*/log", heard)
    other.subscribe("convoy/*/log", still)
    connect(sender, still)
    connect(sender, heard)
    receiver.close()
    receiver.close()
    heard.clear()
    still.clear()
    sender.publish("convoy/lead/log", b"1")
    assert until(lambda: bool(still))
    assert not heard
