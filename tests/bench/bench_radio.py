"""Time of a verdict of a radio: `python -m tests.bench.bench_radio`.

Prints processor microseconds per verdict, in the order of the stream at 20 Hz and 30 m/s: for
presets between the first and the fourth vehicle of a double lane change, and for several numbers of
vehicles in between.
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
    """Messages from the first vehicle to the last, both exactly on the path."""
    route = scenario.route

    def place(vehicle: int, driven: float) -> Position:
        point = route.path.at(route.start_station(vehicle) + driven)
        return Position(point.east, point.north, driven)

    distances = [STEP_M * seq for seq in range(MESSAGES)]
    return [
        TransmissionContext(seq, seq, 130, place(0, distance), place(last, distance))
        for seq, distance in enumerate(distances)
    ]


def microseconds(preset: str, between: int) -> float:
    """Time (µs) per verdict, best of several rounds, each with a new link."""
    last = between + 1
    changes = [f"links.preset={preset}", f"convoy.vehicles={last + 1}"]
    scenario = load_scenario("lane_change", changes)
    names, messages = scenario.vehicle_names, contexts(scenario, last)
    table = scenario.links[names[0], names[last]]
    times = []
    for _ in range(ROUNDS):
        between_vehicles = partial(vehicles_between, scenario.route, 0, last)
        link = Link(link_effects(table, 20.0, between=between_vehicles), 1, names[0], names[last])
        started = process_time()
        for message in messages:
            link.judge(message)
        times.append(process_time() - started)
    return 1e6 * min(times) / MESSAGES


def main() -> None:
    for preset in PRESETS:
        print(f"{preset:18} {microseconds(preset, 2):6.2f} µs")
    for between in COUNTS:
        for preset in PRESETS[-2:]:
            print(f"{preset:18} {microseconds(preset, between):6.2f} µs, {between} in between")


if __name__ == "__main__":
    main()
