"""Warnings of receivers that differ by more than a lane has room for."""

from math import hypot

import pytest

from scenarios.definition.check.findings import check
from scenarios.definition.scenario import load_scenario
from scenarios.studies.many.variant import Variant


def warning_lines(*overrides: str) -> list[str]:
    return [line for line in check("lane_change", overrides).warnings if "receivers differ" in line]


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        ("gnss.preset=rtk_fixed",),
        ("gnss.preset=rtk_float",),
        ("gnss.position_noise_m=0.5",),  # white: it is averaged
        ("gnss.common_drift={deviation_m=3.0}",),  # moves all alike
        ("gnss.bias={east_m=3.0, north_m=-2.0}",),  # so does this
        ("gnss.preset=single", "events.lane_width_m=20"),
    ],
)
def test_sufficient_receivers_get_no_warning(overrides: tuple[str, ...]) -> None:
    assert warning_lines(*overrides) == []


def test_receivers_by_code_alone_are_named_with_how_far_they_differ() -> None:
    (line,) = warning_lines("gnss.preset=single")
    assert line.startswith("v2, v3, v4: ")
    assert f"{2.0 * hypot(1.5, 1.5):.1f} m" in line
    assert "leaves 0.8 m" in line


def test_only_warned_receivers_leave_the_lane_on_clean_links() -> None:
    def departures(preset: str) -> int:
        own = ["duration_s=6", f"gnss.preset={preset}"]
        text = load_scenario("lane_change", own).text
        runs = [Variant(text=text, name="lane_change", seed=seed).run() for seed in range(1, 4)]
        return sum(any(one.kind == "lane_departure" for one in run.events) for run in runs)

    assert departures("single") == 3
    assert departures("rtk_float") == 0
