"""A cut in the picture: the road ahead, modes, sources, and the mark of the change."""

from collections.abc import Iterator
from math import nan
from typing import Any

import pytest

from tests.made.scenarios.messages import START, at, start, tracking, truth
from tests.made.transport.recording import Table, batch_of, scene_of
from tests.made.transport.recording import drawn as drawn_at
from transport.panels import PANELS, flagged
from transport.picture.layout import FEW_VEHICLES, RunExtent, blueprint
from vehicles.messages import Change, Message

VEHICLES = ("v1", "v2", "v3")
CUT_S = 0.4
TICKS = 100


def cut(vehicle: str) -> Change:
    return Change(
        vehicle=vehicle, seq=0, effective_at_ns=at(CUT_S), kind="cut", by_hand=False,
        table='{"kind": "cut", "at_s": 0.4}',
    )  # fmt: skip


def known(seq: int) -> float:
    """Metres of road that v3 knows: from the cut on they grow less by 0.6 m a tick."""
    return 30.0 - 0.6 * max(seq - 20, 0)


def story() -> Iterator[Message]:
    """A convoy at 30 m/s whose last car receives nothing from 0.4 s on, and stops from 1 s on."""
    yield start()
    for seq in range(TICKS):
        for place, name in enumerate(VEHICLES):
            yield truth(name, seq, 0.6 * seq - 15.0 * place, 0.0)
        yield tracking("v1", seq, mode="path")
        yield tracking("v2", seq, mode="lead", known_m=nan, blind_m=nan)
        mode = "composite" if seq < 40 else "coast" if seq < 50 else "stop"
        status = "fresh" if seq < 24 else "late" if seq < 40 else "lost"
        yield tracking(
            "v3", seq, mode=mode, hazard=mode == "stop", known_m=known(seq),
            lead_status=status, predecessor_status=status, blind_m=90.0 - seq,
            lead_received_ratio=0.75,
            predecessor_received_ratio=nan, predecessor_weight_ratio=0.25,
        )  # fmt: skip
        if seq == 20:
            yield cut("v3")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Table:
    path = tmp_path_factory.mktemp("story") / "run.rrd"
    return drawn_at(path, scene_of(VEHICLES), batch_of(story(), START))


def curve(table: Table, entity: str) -> dict[int, float]:
    """VehicleValues of a curve by ticks."""
    rows = table[f"/plots/{entity}"]
    pairs = zip(rows["run_time"], rows["Scalars:scalars"], strict=True)
    return {when // 20_000_000: value[0] for when, value in pairs if value}


def states(table: Table, entity: str) -> list[tuple[float, str]]:
    rows = table[f"/{entity}"]
    pairs = zip(rows["run_time"], rows["StateChange:state"], strict=True)
    return [(when / 1e9, state[0]) for when, state in pairs if state]


def test_known_path_and_blind_distance_are_curves(drawn: Table) -> None:
    curve_known = curve(drawn, "closing/v3/known")
    assert set(curve_known) == set(range(0, TICKS, 2))
    assert curve_known == pytest.approx({seq: known(seq) for seq in curve_known})
    blind = curve(drawn, "closing/v3/blind")
    assert blind == pytest.approx({seq: 90.0 - seq for seq in blind})
    for series in PANELS["closing"].series:
        names = drawn[f"/plots/closing/v3/{series.name}"]["SeriesLines:names"][0]
        assert names == [series.label]


def test_modes_sources_and_warnings_are_strips(drawn: Table) -> None:
    assert states(drawn, "mode/v3") == [
        (0.0, "composite"), (0.8, "coast"), (1.0, flagged("stop", "hazard")),
    ]  # fmt: skip
    expected = [(0.0, "fresh"), (0.48, "late"), (0.8, "lost")]
    assert states(drawn, "sources/v3/lead") == expected
    assert states(drawn, "sources/v3/predecessor") == expected
    assert "/sources/v2/lead" in drawn
    assert "/sources/v2/predecessor" not in drawn  # it is the lead itself


def test_a_change_is_marked_at_its_place_and_time(drawn: Table) -> None:
    spot = drawn["/world/events/change"]
    assert spot["run_time"] == [-1, round(CUT_S * 1e9)]  # the style first
    assert spot["Points2D:positions"][1:] == [[[pytest.approx(0.6 * 20 - 30.0), 0.0]]]
    assert drawn["/world/events/change/name"]["Points2D:labels"][1:] == [["cut v3"]]
    for plot in ("cross_track", "true_gap", "closing/v3"):
        assert curve(drawn, f"{plot}/events/change") == {20: 0.0}
    assert "/plots/closing/v2/events/change" not in drawn
    lines = drawn["/log/v3"]["TextLog:text"]
    assert [line.split(maxsplit=2) for (line,) in lines] == [
        ["0.40", "s", 'v3: change: {"kind": "cut", "at_s": 0.4}']
    ]


def test_share_and_weight_are_curves_in_per_cent(drawn: Table) -> None:
    assert set(curve(drawn, "received/v3/lead").values()) == {75.0}
    assert set(curve(drawn, "weight/v3").values()) == {25.0}


def views(part: Any) -> Iterator[Any]:
    """Visible views: of tabs the active one."""
    inner = list(getattr(part, "contents", []))
    if type(part).__name__ == "Tabs":
        inner = [inner[part.active_tab or 0]]
    if not inner or not hasattr(inner[0], "contents"):
        yield part
        return
    for view in inner:
        yield from views(view)


@pytest.mark.parametrize(("count", "followed"), [(2, "v2"), (4, "v3"), (9, "v5")])
def test_the_main_views_are_visible_at_once(count: int, followed: str) -> None:
    names = [f"v{place}" for place in range(1, count + 1)]
    shown = list(views(blueprint(scene_of(names), RunExtent(30.0)).root_container))
    assert {view.origin for view in shown} >= {
        "plots/cross_track", f"plots/closing/{followed}", "plots/true_gap", "legend", "log",
        "world/convoy",
    }  # fmt: skip
    states = [
        part for view in shown if "StateTimeline" in type(view).__name__ for part in view.contents
    ]
    assert "/links/**" in states
    assert ("/mode/**" in states) == (count <= FEW_VEHICLES)
