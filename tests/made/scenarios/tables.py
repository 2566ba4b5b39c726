"""Tables of a run from messages, for a convoy on a straight road eastwards."""

from collections.abc import Sequence
from functools import cache

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.tables import KINDS, Collector, RunTables
from scenarios.results.true_motion import BodySize, sizes_of
from tests.made.scenarios.messages import STRAIGHT, start
from transport.topics import valid_at
from vehicles.messages import Message
from vehicles.schedule import SECOND

CONVOY = ("v1", "v2", "v3")
LENGTH, WIDTH = 5.0, 2.0
"""Size (m) of the bodies of all vehicles."""


@cache
def straight_scenario(count: int = 3, overrides: tuple[str, ...] = ()) -> Scenario:
    sizes = [
        f"vehicle.v{place}.parameters.{key}={size}"
        for place in range(1, count + 1)
        for key, size in (("length_m", LENGTH), ("width_m", WIDTH))
    ]
    own = [f"convoy.vehicles={count}", *sizes, *overrides]
    return scenario_from_text(STRAIGHT, label="straight", overrides=own)


@cache
def body_size() -> BodySize:
    return sizes_of(straight_scenario())["v1"]


def run_of(
    *messages: Message, count: int = 3, overrides: Sequence[str] = (), ran_s: float = 0.0
) -> RunTables:
    """Tables of messages of `count` vehicles, each recorded when it was valid."""
    collector = Collector()
    collector.listen(start().start_at_ns, start())
    for message in messages:
        if type(message) in KINDS:
            collector.listen(valid_at(message), message)
    scenario = straight_scenario(count, tuple(overrides))
    return RunTables(scenario, collector.tables(), round(ran_s * SECOND))
