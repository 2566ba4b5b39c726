"""The table of topics: complete, consistent, with valid Zenoh keys."""

from dataclasses import fields
from typing import get_args

import pytest
import zenoh

from transport.topics import RUN_SENDER, TOPIC_OF, TOPICS, Topic, alive_key, key, valid_at
from vehicles.messages import GpsPose, Message, RunStart


def test_every_message_has_its_topic() -> None:
    assert set(TOPIC_OF) == set(get_args(Message))
    assert len(TOPICS) == len(TOPIC_OF)


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_a_topics_instant_is_a_field_of_its_message(topic: Topic) -> None:
    assert topic.instant in {f.name for f in fields(topic.message)}
    assert topic.instant.endswith("_at_ns")


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_every_message_has_vehicle_and_number(topic: Topic) -> None:
    assert [f.name for f in fields(topic.message)][:2] == ["vehicle", "seq"]


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_keys_are_canonical_in_zenoh(topic: Topic) -> None:
    name = key("follower_1", topic)
    assert str(zenoh.KeyExpr.autocanonize(name)) == name


def test_subscribing_to_everything_passes_liveliness_by() -> None:
    everything = zenoh.KeyExpr("convoy/**")
    assert everything.includes(zenoh.KeyExpr(key(RUN_SENDER, TOPICS["start"])))
    assert not everything.intersects(zenoh.KeyExpr(alive_key("vehicle", "lead", "print", "1")))


def test_poses_precede_messages_for_the_log() -> None:
    assert {name for name, topic in TOPICS.items() if topic.urgent} == {"gps", "start", "end"}


def test_the_instant_of_a_message_is_read_by_the_table() -> None:
    assert valid_at(RunStart(vehicle="run", seq=0, start_at_ns=17, run_id="x")) == 17
    assert TOPIC_OF[GpsPose].instant == "sent_at_ns"
