"""Random, consistent loss laws of a link."""

from random import Random
from typing import Any

Raw = dict[str, Any]


def drawn_loss(chance: Random) -> Raw:
    return chance.choice(
        [_none, _mean_values, _chances, _four_state, _every_nth, _listed, _pattern, _log]
    )(chance)


def drawn_collisions(chance: Random) -> Raw:
    least = chance.choice([1, 5, 25])
    lengths = {
        "reselection_messages_min": least,
        "reselection_messages_max": least + chance.choice([0, 10]),
    }
    table = {"loss_ratio": chance.choice([0.0, 1.0, chance.random()])}
    if chance.random() < 0.5:
        table |= {"keep_ratio": chance.choice([0.0, 0.4, 0.8])}
    return table | lengths if chance.random() < 0.5 else table


def inline(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {inline(entry)}" for key, entry in value.items()) + "}"
    return repr(value)


def _none(_chance: Random) -> Raw:
    return {"kind": "none"}


def _mean_values(chance: Random) -> Raw:
    loss = chance.uniform(0.0, 0.8)
    burst = max(loss / (1.0 - loss), 1.0) * chance.uniform(1.01, 8.0)
    return {"kind": "gilbert_elliott", "loss_ratio": loss, "burst_messages_mean": burst}


def _chances(chance: Random) -> Raw:
    table = {
        "kind": "gilbert_elliott",
        "good_to_bad_ratio": chance.choice([0.0, chance.uniform(0.01, 0.95)]),
        "bad_to_good_ratio": chance.choice([1.0, chance.uniform(0.01, 0.95)]),
    }
    if chance.random() < 0.5:
        table |= {"bad_delivered_ratio": chance.random(), "good_delivered_ratio": chance.random()}
    return table


def _four_state(chance: Random) -> Raw:
    table = {
        "kind": "four_state",
        "gap_to_burst_ratio": chance.uniform(0.01, 0.5),
        "burst_to_gap_ratio": chance.uniform(0.05, 0.6),
    }
    if chance.random() < 0.5:
        table |= {
            "lost_to_sent_ratio": chance.uniform(0.0, 0.3),
            "sent_to_lost_ratio": chance.uniform(0.1, 1.0),
            "isolated_loss_ratio": chance.uniform(0.0, 0.3),
        }
    return table


def _every_nth(chance: Random) -> Raw:
    table = {"kind": "every_nth", "every_messages": chance.choice([1, 2, 7, 10**9])}
    return table | ({"first_number": chance.randrange(20)} if chance.random() < 0.5 else {})


def _numbers(chance: Random) -> str:
    firsts = sorted(chance.sample(range(19), 3))
    return f"{firsts[0]}, {firsts[1]}-{firsts[2]}"


def _listed(chance: Random) -> Raw:
    return {"kind": "listed", "lost_numbers": chance.choice(["", _numbers(chance)])}


def _pattern(chance: Random) -> Raw:
    table = {"kind": "pattern", "length_messages": 20, "lost_numbers": _numbers(chance)}
    return table | (
        {"after_end": chance.choice(["repeat", "pass"])} if chance.random() < 0.5 else {}
    )


def _log(chance: Random) -> Raw:
    delays = f"{chance.randrange(10**8)}x7, {chance.randrange(10**9)}, 30000000x12"
    dropped = {chance.choice(["loss", "rate", "burst", "wormhole"]): _numbers(chance)}
    table = {"kind": "log", "delays_ns": delays, "dropped_numbers": dropped}
    return table | (
        {"after_end": chance.choice(["repeat", "pass"])} if chance.random() < 0.5 else {}
    )
