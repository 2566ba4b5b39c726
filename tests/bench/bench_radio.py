"""What a verdict of a radio costs: `python -m tests.bench.bench_radio`.

Prints microseconds of the processor for each message and verdict, in the order of the stream at
20 Hz and 30 m/s: for presets between the first and the fourth vehicle of a double lane change, and
for vehicles in the way by how many there are.
"""

from functools import partial
from time import process_time

from scenarios.definition.channel.build import link_effects, vehicles_between
from scenarios.definition.scenario import Scenario, load_scenario
from transport.links.laws.effect import Position, TransmissionContext
from transport.links.link import Link

ROUNDS, MESSAGES, STEP_M = 5, 10_000, 1.5
PRESETS = (
    "clear", "lossy", "ieee80211p_jam", "lte_v2x_dense", "lte_v2x_oneshot", "nlosv_etsi",
    "nlosv_3gpp_truck",
)  # fmt: skip
COUNTS = (0, 5, 11, 29)


def contexts(scenario: Scenario, last: int) -> list[TransmissionContext]:
    """Messages of the first vehicle to the last, both on the path exactly."""
    route = scenario.route

    def place(vehicle: int, driven: float) -> Position:
        point = route.path.at(route.start_station(vehicle) + driven)
        return Position(point.east, point.north, driven)

    ways = [STEP_M * seq for seq in range(MESSAGES)]
    return [
        TransmissionContext(seq, seq, 130, place(0, way), place(last, way))
        for seq, way in enumerate(ways)
    ]


def microseconds(preset: str, between: int) -> float:
    """Least time of a few rounds, each with a link that remembers nothing yet."""
    last = between + 1
    changes = [f"links.preset={preset}", f"convoy.vehicles={last + 1}"]
    scenario = load_scenario("lane_change", changes)
    names, messages = scenario.vehicle_names, contexts(scenario, last)
    asked = scenario.links[names[0], names[last]]
    times = []
    for _ in range(ROUNDS):
        around = partial(vehicles_between, scenario.route, 0, last)
        link = Link(link_effects(asked, 20.0, between=around), 1, names[0], names[last])
        began = process_time()
        for message in messages:
            link.judge(message)
        times.append(process_time() - began)
    return 1e6 * min(times) / MESSAGES


def main() -> None:
    """Print the table."""
    for preset in PRESETS:
        print(f"{preset:18} {microseconds(preset, 2):6.2f} µs")
    for between in COUNTS:
        for preset in PRESETS[-2:]:
            print(f"{preset:18} {microseconds(preset, between):6.2f} µs, {between} in between")


if __name__ == "__main__":
    main()
