"""The table of topics: complete, consistent, with valid Zenoh keys."""

from typing import get_args

import pytest
import zenoh

from transport.topics import RUN_SENDER, TOPIC_OF, TOPICS, Topic, alive_key, key
from vehicles.messages import Message


def test_every_message_has_its_topic() -> None:
    assert set(TOPIC_OF) == set(get_args(Message))
    assert len(TOPICS) == len(TOPIC_OF)


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
