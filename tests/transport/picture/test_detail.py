"""How much is drawn of a long convoy."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.scenarios.messages import START, at, truth
from tests.made.transport import drive
from tests.made.transport.recording import batch_of, drawn, scene_of
from transport.picture.batch import VehicleValues
from transport.picture.layout import MAX_ALL_DETAILED, detailed
from vehicles.messages import Message


def names(count: int) -> list[str]:
    return [f"v{place}" for place in range(1, count + 1)]


@given(st.integers(min_value=MAX_ALL_DETAILED + 1, max_value=200))
def test_of_a_long_one_evenly_spread_vehicles_with_first_and_last(count: int) -> None:
    vehicles = names(count)
    places = [vehicles.index(name) for name in detailed(vehicles)]
    assert places[0] == 0
    assert places[-1] == count - 1
    steps = [after - before for before, after in pairwise(places)]
    assert max(steps) - min(steps) <= 1


def test_the_picture_of_forty_has_all_cars_and_the_curves_of_some(tmp_path: Path) -> None:
    vehicles = names(40)
    messages: list[Message] = []
    for tick in range(100):
        ahead = replace(drive.trajectory("v2", tick), decided_at_ns=at(tick / 50))
        for place, name in enumerate(vehicles):
            messages.append(truth(name, tick, 0.6 * tick - 15.0 * place, 0.0))
            messages.append(replace(ahead, vehicle=name))
    times = np.array([at(tick / 50) for tick in range(100)])
    errors = {
        name: VehicleValues(times, np.full(100, 0.3 * (name == "v20"))) for name in vehicles[1:]
    }
    batch = batch_of(messages, START, errors)
    table = drawn(tmp_path / "long.rrd", scene_of(vehicles), batch)
    some = set(detailed(vehicles))
    for name in vehicles:
        assert len(table[f"/world/cars/{name}"]["Transform3D:translation"]) == 50
        assert (f"/plots/speed/{name}" in table) == (name in some)
        assert (len(table[f"/world/trajectory/{name}"]["run_time"]) > 1) == (name in some)
    # Errors are drawn for all vehicles, so the largest one is always among them.
    assert "v20" not in some
    assert table["/world/cars/v20/worst/name"]["Points2D:labels"][1] == ["v20 +0.30 m"]
    curve = table["/plots/cross_track/v20"]["Scalars:scalars"]
    assert curve[-1] == pytest.approx([0.3])
