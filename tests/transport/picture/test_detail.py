"""How much is drawn of a long convoy."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.scenarios.messages import START, at, start, truth
from tests.made.transport import drive
from tests.made.transport.recording import columns
from transport.picture.blueprint import MAX_ALL_DETAILED, Detail
from transport.picture.option import parse_rerun_option
from transport.picture.view import RerunView


def names(count: int) -> list[str]:
    return [f"v{place}" for place in range(1, count + 1)]


@given(st.integers(min_value=MAX_ALL_DETAILED + 1, max_value=200))
def test_of_a_long_one_evenly_spread_vehicles_with_first_and_last(count: int) -> None:
    vehicles = names(count)
    detail = Detail(vehicles)
    places = [vehicles.index(name) for name in detail.names]
    assert places[0] == 0
    assert places[-1] == count - 1
    steps = [after - before for before, after in pairwise(places)]
    assert max(steps) - min(steps) <= 1
    assert detail.followed in detail.names[1:-1]
    assert all((name in detail) == (name in detail.names) for name in vehicles)
    assert abs(detail.period(1_000) / 1_000 - count / len(places)) < 0.001


def test_the_picture_of_forty_has_all_cars_and_the_curves_of_some(tmp_path: Path) -> None:
    vehicles = names(40)
    path = tmp_path / "long.rrd"
    with RerunView(parse_rerun_option(f"save={path}"), recording_id="x", vehicles=vehicles) as view:
        view.draw(START, start())
        for tick in range(100):
            ahead = replace(drive.trajectory("v2", tick), decided_at_ns=at(tick / 50))
            for place, name in enumerate(vehicles):
                off = 0.3 if name == "v20" else 0.0
                pose = truth(name, tick, 0.6 * tick - 15.0 * place, off)
                view.draw(pose.true_at_ns, pose)
                view.error(name, pose.true_at_ns, off)
                view.draw(pose.true_at_ns, replace(ahead, vehicle=name))
        assert [name for name in vehicles if view.has_curves(name)] == list(Detail(vehicles).names)
    drawn = columns(path)
    detailed = set(Detail(vehicles).names)
    for name in vehicles:
        moved = drawn[f"/world/cars/{name}"]["Transform3D:translation"]
        assert len(moved) == 10  # 2 s, a fifth of a second apart
        assert (f"/plots/speed/{name}" in drawn) == (name in detailed)
        assert (len(drawn[f"/world/trajectory/{name}"]["run_time"]) > 1) == (name in detailed)
    # Whoever is furthest off is ringed, and its error drawn, whether it is among them or not.
    assert "v20" not in detailed
    assert "/world/cars/v20/worst" in drawn
    furthest = drawn["/plots/cross_track/worst"]["Scalars:scalars"]
    assert furthest[-1] == pytest.approx([0.3])
