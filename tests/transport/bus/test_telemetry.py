"""Batches of messages: unpacking inverts packing, and invalid records affect no others."""

from contextlib import suppress

from hypothesis import given
from hypothesis import strategies as st

from transport.bus.telemetry import MAX_RECORDS_BYTES, BatchRecord, packed, records_key, unpacked
from transport.codec import MAX_BYTES, RefusedMessageError
from transport.topics import TOPICS, key

BATCHED = [topic.name for topic in TOPICS.values() if topic.batched]
records = st.lists(
    st.builds(
        BatchRecord,
        st.sampled_from(BATCHED),
        st.integers(-(2**63), 2**63 - 1),
        st.binary(max_size=200) | st.integers(0, MAX_BYTES).map(bytes),
    ),
    max_size=30,
)


@given(records)
def test_batches_keep_the_order_and_their_maximum_size(sent: list[BatchRecord]) -> None:
    batches = list(packed(sent))
    assert [one for batch in batches for one in unpacked(batch)] == sent
    assert all(0 < len(batch) <= MAX_RECORDS_BYTES for batch in batches)
    assert len(batches) <= 1 + sum(len(one.data) + 48 for one in sent) // (MAX_RECORDS_BYTES // 2)


@given(st.binary(max_size=300))
def test_bytes_that_are_no_batch_are_refused_and_nothing_else_happens(data: bytes) -> None:
    with suppress(RefusedMessageError):
        assert all(one.topic in ("", *BATCHED) for one in unpacked(data))


def test_poses_and_instants_of_the_run_are_never_batched() -> None:
    assert not any(topic.urgent and topic.batched for topic in TOPICS.values())
    assert {"gps", "start", "end", "log", "health", "change"}.isdisjoint(BATCHED)
    assert records_key("v2") not in {key("v2", topic) for topic in TOPICS.values()}
