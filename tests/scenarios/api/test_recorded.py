"""Runs opened from Python: arrays, tables of other libraries, and notebooks."""

import copy
import pickle
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import scenarios.api as convoy
from scenarios.results.data_table import DataTable

SETTINGS = {
    "duration_s": 4.0,
    "links.loss_ratio": 0.3,
    "links.latency_ms": 150.0,
    "change": [{"kind": "cut", "at_s": 1.0, "for_s": 0.5}],
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> convoy.Run:
    with pytest.warns(UserWarning, match="latency"):
        return convoy.run(set=SETTINGS, out=tmp_path_factory.mktemp("api") / "run")


def test_a_folder_and_its_log_are_the_same_run(run: convoy.Run) -> None:
    assert convoy.open(run.log.parent).log == convoy.open(run.log).log == run.log
    assert list(run.vehicles) == ["v1", "v2", "v3", "v4"]
    assert run.faults == ""


def test_true_figures_are_those_of_the_summary(run: convoy.Run) -> None:
    for vehicle in run.summary.vehicles:
        true = run.vehicles[vehicle.name].true
        assert len(true) == len(true.error_m) == len(true.t_s) == 200
        if vehicle.role == "lead":
            assert np.isnan([true.error_m, true.gap_m, true.station_m]).all()
            continue
        error_m = true.error_m[true.station_m >= 0.0]
        assert vehicle.cross_track_error_m_max == np.abs(error_m).max()
        assert vehicle.cross_track_error_m_rms == pytest.approx(np.sqrt((error_m**2).mean()))
        assert vehicle.true_gap_m_min == true.gap_m.min()
        assert vehicle.true_gap_m_max == true.gap_m.max()
        assert vehicle.true_gap_max_at_s == true.t_s[true.gap_m.argmax()]
        assert np.all(np.diff(true.station_m) > 0.0)


def test_times_begin_at_the_start_of_the_run(run: convoy.Run) -> None:
    true = run.vehicles["v2"].true
    assert true.t_s.tolist() == pytest.approx(np.arange(200) / 50.0)
    assert (true.at_ns - run.start_at_ns).tolist() == [20_000_000 * k for k in range(200)]


def test_outcomes_of_a_link_are_counted_in_the_summary(run: convoy.Run) -> None:
    for link in run.summary.links:
        rows = run.links[link.sender, link.receiver].outcomes
        assert rows.number.tolist() == list(range(link.sent))
        outcomes = Counter(rows.outcome.tolist())
        assert outcomes["delivered"] == link.delivered
        assert outcomes["in_flight"] == link.in_flight == 3
        causes = Counter(cause for cause in rows.cause.tolist() if cause)
        assert causes == link.dropped
        assert causes["cut"] == 10
        delivered = rows.outcome == "delivered"
        assert rows.delay_s[delivered] == pytest.approx(0.15)
        assert np.isnan(rows.delay_s[~delivered]).all()


def test_unknown_names_are_refused_with_those_that_exist(run: convoy.Run) -> None:
    with pytest.raises(convoy.Error, match="allowed v1, v2, v3, v4"):
        run.vehicles["v9"]
    with pytest.raises(convoy.Error, match="v1"):
        run.links["v4", "v1"]
    with pytest.raises(convoy.Error, match="speed_mps"):
        run.vehicles["v1"].true["speed"]
    assert not hasattr(run.vehicles["v1"].true, "speed")
    assert "speed_mps" in dir(run.vehicles["v1"].true)
    assert "v9" not in run.vehicles
    with pytest.raises(convoy.Error, match="trajectory"):
        _ = run.vehicles["v1"].trajectory  # the lead has none


def test_a_truncated_log_is_opened(run: convoy.Run, tmp_path: Path) -> None:
    data = run.log.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    cut = convoy.open(tmp_path / "cut.mcap")
    assert cut.faults
    true, whole = cut.vehicles["v3"].true, run.vehicles["v3"].true
    count = len(true)
    assert 0 < count < len(whole)
    assert true.east_m.tolist() == whole.east_m[:count].tolist()
    known = np.isfinite(true.error_m)
    assert known.sum() > count - 5
    assert true.error_m[known].tolist() == whole.error_m[:count][known].tolist()


def test_tables_of_other_libraries_have_the_same_values(run: convoy.Run) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    rows = run.links["v1", "v3"].outcomes
    lost = int((rows.outcome != "delivered").sum())
    pandas, polars, arrow = rows.to_pandas(), rows.to_polars(), rows.to_arrow()
    assert list(pandas) == polars.columns == arrow.column_names == list(rows.keys())
    assert pandas["delay_s"].isna().sum() == polars["delay_s"].null_count() == lost
    assert arrow["delay_s"].null_count == lost
    assert polars["cause"].null_count() == pandas["cause"].isna().sum() == 80 - lost + 3
    assert arrow["number"].to_pylist() == polars["number"].to_list() == rows.number.tolist()
    trajectory = run.vehicles["v3"].trajectory
    pieces = trajectory.to_arrow()["piece_length_m"]
    assert pyarrow.types.is_large_list(pieces.type)
    assert pieces.to_pylist() == [row.tolist() for row in trajectory.piece_length_m]
    assert trajectory.to_polars()["piece_length_m"].to_list() == pieces.to_pylist()


def test_rows_become_columns_with_unknown_values() -> None:
    table = DataTable.of_rows(
        [
            {"a": 1, "b": None, "c": "x", "d": True, "e": 1, "f": None},
            {"a": 2, "b": 1.5, "c": None, "d": False, "e": None, "f": None},
        ]
    )
    assert table.a.dtype == np.int64
    assert np.isnan(table.b[0])
    assert table.c.tolist() == ["x", None]
    assert table.d.dtype == np.bool_
    assert np.isnan(table.e[1])
    assert table.f.tolist() == [None, None]
    assert copy.copy(table).a.tolist() == pickle.loads(pickle.dumps(table)).a.tolist() == [1, 2]


def test_a_notebook_shows_figures(run: convoy.Run) -> None:
    html = run._repr_html_()
    assert "lane_change" in html
    assert html.count("<tr>") == 5
    assert "<td>…</td>" in run.vehicles["v2"].true._repr_html_()
    shown = DataTable({"name": np.array(["<b>"], object)})._repr_html_()
    assert "<b>" not in shown


def test_a_plot_has_the_vehicles(run: convoy.Run) -> None:
    figure = run.plot(["v1", "v3"])
    paths, errors, speeds, gaps = figure.axes
    assert [len(axes.lines) for axes in (paths, errors, speeds, gaps)] == [2, 1, 2, 1]
    assert (
        np.array(errors.lines[0].get_ydata()).tolist() == run.vehicles["v3"].true.error_m.tolist()
    )
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("method", "package", "extra"),
    [
        ("to_pandas", "pandas", "pandas"),
        ("to_polars", "polars", "polars"),
        ("to_arrow", "pyarrow", "tables"),
    ],
)
def test_a_missing_library_is_named_with_its_extra(
    method: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "scenarios.definition.errors.find_spec", lambda name: None if name == package else name
    )
    with pytest.raises(convoy.Error, match=rf"{package}.*convoy-emulator\[{extra}\]"):
        getattr(DataTable({"x_m": np.zeros(1)}), method)()
