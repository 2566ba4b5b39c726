"""The outcome of each message of each link in a log."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from scenarios.results.channel.account import CAUSE_WORDS, Link, MissingVerdict
from scenarios.results.metrics import Metrics
from scenarios.results.recorded.column_messages import messages_of
from transport.columns import Columns
from transport.topics import TOPIC_OF
from vehicles.messages import (
    Change,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    RunStart,
    Tracking,
)
from vehicles.schedule import SECOND

ACCOUNTED: tuple[type[Message], ...] = (
    *(RunStart, GpsPose, LinkVerdict),
    *(Tracking, Health, Change, LogText),
)
"""Messages by which those without a verdict are accounted for."""


class LinkOutcomes(NamedTuple):
    """Messages of a link in the order of their numbers; shapes (N).

    `outcome` is delivered, dropped, not_arrived (the real transport lost it or the receiver did not
    run), in_flight (due after the end of the record) or unrecorded (the log lacks the verdict).
    `cause` is the reason of a drop, or why a message did not arrive; None otherwise. `delay_s` is
    the time from sending until the receiver can use the message, NaN unless it was delivered.
    """

    number: NDArray[np.int64]
    sent_at_ns: NDArray[np.int64]
    outcome: NDArray[np.object_]
    cause: NDArray[np.object_]
    delay_s: NDArray[np.float64]


def missing_verdicts(
    scenario: Scenario, columns_of: Callable[[str], Mapping[str, Columns]], last_at: int
) -> Mapping[Link, Sequence[MissingVerdict]]:
    """Messages of each link without a verdict, as the summary accounts for them.

    `columns_of` returns the messages of a topic by vehicle; `last_at` (ns) is the end of the log.
    """
    metrics = Metrics.of(scenario)
    for kind in ACCOUNTED:
        for columns in columns_of(TOPIC_OF[kind].name).values():
            messages = messages_of(columns, kind)
            for at, message in zip(columns.logged_at_ns.tolist(), messages, strict=True):
                metrics.listen(at, message)
    ran_ns = max(last_at - (metrics.start_at or last_at), 0)
    return {link: account.missing for link, account in metrics.accounts(ran_ns).items()}


def link_outcomes(
    link: Link, verdicts: Columns | None, missing: Sequence[MissingVerdict]
) -> LinkOutcomes:
    """Join the verdicts of a receiver on one link, and its messages without one."""
    known = _judged(link, verdicts) if verdicts is not None else _without_verdict(())
    parts = known, _without_verdict(missing)
    joined = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    order = np.argsort(joined[0], kind="stable")
    return LinkOutcomes(*(column[order] for column in joined))


def _judged(link: Link, verdicts: Columns) -> LinkOutcomes:
    rows = np.flatnonzero(verdicts["sender"] == link[0])
    columns = {name: column[rows] for name, column in verdicts.fields.items()}
    delivered = columns["outcome"] == "delivered"
    usable_at = np.where(columns["late"], columns["received_at_ns"], columns["visible_at_ns"])
    delays = (usable_at - columns["sent_at_ns"]) / SECOND
    return LinkOutcomes(
        columns["pose_seq"],
        columns["sent_at_ns"],
        columns["outcome"],
        np.where(delivered, np.array(None, object), columns["reason"]),
        np.where(delivered, delays, np.nan),
    )


def _without_verdict(missing: Sequence[MissingVerdict]) -> LinkOutcomes:
    outcomes = ["not_arrived" if row.fate in CAUSE_WORDS else row.fate for row in missing]
    causes = [row.fate if row.fate in CAUSE_WORDS else None for row in missing]
    return LinkOutcomes(
        np.array([row.number for row in missing], np.int64),
        np.array([row.sent_at for row in missing], np.int64),
        np.array(outcomes, object),
        np.array(causes, object),
        np.full(len(missing), np.nan),
    )
