"""Time of a verdict: `python -m tests.bench.bench_links`.

Prints microseconds per verdict of a link for each law, in the order of the stream, including its
context. Further columns are multiples of the plain chain (rate, loss, latency, jitter) and of an
addition in a plain loop, both measured in the same run. Times are processor times. The second table
has single verdicts on distant numbers, without cached state.
"""

import sys
import timeit
from collections.abc import Callable
from time import process_time

from scenarios.definition.channel.build import link_effects
from scenarios.definition.schema.link_tables import LinkTable
from transport.links.laws.link_law import Position, TransmissionContext
from transport.links.link import Link

ROUNDS, MESSAGES, ADDITIONS, ALONE = 7, 20_000, 1_000_000, 300
PERIOD_NS = 50_000_000
PLAIN_US, COSTLIEST_US = 4.0, 10.0


PLAIN = {"latency_ms": 20.0, "jitter_ms": 10.0, "loss_ratio": 0.1}
RECORD = ", ".join(str(20_000_000 + 1_000 * k) for k in range(2000))
LAWS: dict[str, tuple[dict[str, object], float]] = {
    "latency": ({}, PLAIN_US),
    "loss": ({"loss_ratio": 0.1}, PLAIN_US),
    "every nth": ({"loss": {"kind": "every_nth", "every_messages": 5}}, PLAIN_US),
    "listed": ({"loss": {"kind": "listed", "lost_numbers": "3, 7, 10-20"}}, PLAIN_US),
    "pattern": (
        {"loss": {"kind": "pattern", "length_messages": 500, "lost_numbers": "3, 10-20"}},
        PLAIN_US,
    ),
    "log": (
        {"loss": {"kind": "log", "delays_ns": RECORD, "dropped_numbers": {"loss": "3, 10-20"}}},
        PLAIN_US,
    ),
    "Gilbert–Elliott": (
        {"loss": {"kind": "gilbert_elliott", "loss_ratio": 0.1, "burst_messages_mean": 4.0}},
        COSTLIEST_US,
    ),
    "Gilbert–Elliott, h and k": (
        {
            "loss": {
                "kind": "gilbert_elliott",
                "good_to_bad_ratio": 0.03,
                "bad_to_good_ratio": 0.25,
                "bad_delivered_ratio": 0.3,
                "good_delivered_ratio": 0.99,
            }
        },
        COSTLIEST_US,
    ),
    "four states": (
        {
            "loss": {
                "kind": "four_state",
                "gap_to_burst_ratio": 0.03,
                "burst_to_gap_ratio": 0.2,
                "lost_to_sent_ratio": 0.15,
                "sent_to_lost_ratio": 0.4,
                "isolated_loss_ratio": 0.02,
            }
        },
        COSTLIEST_US,
    ),
    "collisions": ({"collisions": {"loss_ratio": 0.1}}, COSTLIEST_US),
    "collisions, kept": ({"collisions": {"loss_ratio": 0.1, "keep_ratio": 0.8}}, COSTLIEST_US),
    "all combined": (
        {
            **PLAIN,
            "rate_hz": 15.0,
            "loss": {"kind": "gilbert_elliott", "loss_ratio": 0.1, "burst_messages_mean": 4.0},
            "collisions": {"loss_ratio": 0.1, "keep_ratio": 0.8},
        },
        COSTLIEST_US,
    ),
}
ALONE_LAWS = ("Gilbert–Elliott", "four states", "collisions", "collisions, kept")


def best_us(work: Callable[[], object], calls: int) -> float:
    """Mean time (µs) of one of `calls` calls, best of several rounds."""
    return min(timeit.repeat(work, timer=process_time, number=1, repeat=ROUNDS)) / calls * 1e6


def addition_us() -> float:
    """Current time (µs) of an addition in a plain loop."""

    def additions() -> None:
        total = 0.0
        for k in range(ADDITIONS):
            total += k * 0.5

    return best_us(additions, ADDITIONS)


def link(table: dict[str, object]) -> Link:
    """The configured link, from a sender at 20 Hz."""
    return Link(link_effects(LinkTable.model_validate(table), 20.0), 1, "v1", "v2")


def stream_us(table: dict[str, object]) -> float:
    """Time (µs) per message of a stream."""
    tested, here, there = link(table), Position(1.0, 2.0, 3.0), Position(4.0, 5.0, 6.0)

    def judge_all() -> None:
        for seq in range(MESSAGES):
            tested.judge(TransmissionContext(seq, seq * PERIOD_NS, 100, here, there))

    return best_us(judge_all, MESSAGES)


def alone_us(table: dict[str, object]) -> float:
    """Time (µs) of a verdict without cached state."""
    tested = link(table)

    def judge_some() -> None:
        for k in range(ALONE, 0, -1):
            tested.judge(TransmissionContext(100_000 * k, 0))

    return best_us(judge_some, ALONE)


def main() -> int:
    addition, plain = addition_us(), stream_us({**PLAIN, "rate_hz": 15.0})
    print(f"{'in the stream':28s}{'µs':>8s}{'× plain':>10s}{'additions':>12s}{'limit':>8s}")
    rows = {"plain: all four": plain}
    rows |= {name: stream_us(table) for name, (table, _) in LAWS.items()}
    for name, spent in rows.items():
        limit = LAWS[name][1] if name in LAWS else PLAIN_US
        verdict = "ok" if spent <= limit else "OVER"
        print(
            f"{name:28s}{spent:8.2f}{spent / plain:10.2f}{spent / addition:12.0f}"
            f"{limit:8.0f}  {verdict}"
        )
    print(f"\n{'single':28s}{'µs':>8s}{'× plain':>10s}{'additions':>12s}")
    for name in ALONE_LAWS:
        spent = alone_us(LAWS[name][0])
        print(f"{name:28s}{spent:8.1f}{spent / plain:10.1f}{spent / addition:12.0f}")
    print(f"\nan addition in a plain loop takes {1e3 * addition:.1f} ns")
    return 0


if __name__ == "__main__":
    sys.exit(main())
