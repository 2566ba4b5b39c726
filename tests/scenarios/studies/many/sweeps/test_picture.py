"""The picture of a sweep has the values and intervals of its cells."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer

from scenarios.studies.job import write_file
from scenarios.studies.many.cell_table import SweepTable, table_of
from scenarios.studies.many.pictures import sweep_picture
from tests.made.many.small_sweeps import small_plan

FUSIONS, LOSS = "control.fusion=composite,blend", "links.loss_ratio=0.5,0,0.8"
GAPS = "convoy.gap_m=3,10"


def swept(*vary: str) -> SweepTable:
    plan = small_plan(vary, seeds=3)
    entries = {
        f"{cell}/{seed}": {
            "outcome": "completed",
            "reason": "",
            "figures": [0.01 * (cell + 1) * seed, None],
            "broken": [cell > 1, cell * seed > 2],
        }
        for cell in range(len(plan.cells))
        for seed in (1, 2, 3)
    }
    return table_of(plan, entries)


def places_of(table: SweepTable) -> list[Axes]:
    return sweep_picture(table).axes[:4]


def lines_of(place: Axes) -> dict[str, ErrorbarContainer]:
    bars = [one for one in place.containers if isinstance(one, ErrorbarContainer)]
    return {str(one.get_label()): one for one in bars}


@pytest.mark.parametrize("vary", [(FUSIONS, LOSS), (LOSS, FUSIONS)])
def test_a_line_has_the_means_of_its_value_over_the_numbers(vary: tuple[str, ...]) -> None:
    table = swept(*vary)
    lane, _, error, _ = places_of(table)
    assert (error.get_xlabel(), error.get_ylabel()) == (
        "loss of all links, %",
        "largest cross-track error, m",
    )
    assert lane.get_ylim() == (0.0, 100.0)
    assert {*lines_of(error)} == {"composite", "blend"}
    place = 0 if vary[0] == FUSIONS else 1
    for fusion, line in lines_of(error).items():
        cells = {
            float(one.values[1 - place]): one for one in table.cells if one.values[place] == fusion
        }
        curve, _, (bars,) = line.lines
        assert curve.get_xdata() == pytest.approx([0.0, 50.0, 80.0], abs=1.0)
        spreads = [cells[loss].figures[0] for loss in (0.0, 0.5, 0.8)]
        assert curve.get_ydata() == pytest.approx([one.mean for one in spreads])
        ends = [[segment[0][1], segment[1][1]] for segment in bars.get_segments()]
        assert np.array(ends) == pytest.approx(
            np.array([[one.mean_low, one.mean_high] for one in spreads])
        )
        shares = [cells[loss].limits[0].ratio for loss in (0.0, 0.5, 0.8)]
        assert lines_of(lane)[fusion].lines[0].get_ydata() == pytest.approx(
            [100.0 * (share or 0.0) for share in shares]
        )


def test_two_keys_with_numbers_give_heat_maps() -> None:
    table = swept(LOSS, GAPS)
    lane, _, error, _ = places_of(table)
    mesh = error.collections[0]
    means = {cell.values: cell.figures[0].mean for cell in table.cells}
    wanted = [[means[loss, gap] for loss in ("0", "0.5", "0.8")] for gap in ("3", "10")]
    assert np.asarray(mesh.get_array()) == pytest.approx(np.array(wanted))
    assert (error.get_xlabel(), error.get_ylabel()) == ("loss of all links, %", "gap, m")
    assert lane.collections[0].get_clim() == (0.0, 100.0)


@pytest.mark.parametrize("vary", [(LOSS,), (FUSIONS, LOSS), (LOSS, GAPS)])
def test_equal_sweeps_give_equal_pictures_with_embedded_fonts(
    vary: tuple[str, ...], tmp_path: Path
) -> None:
    files = [tmp_path / "one.pdf", tmp_path / "other.pdf"]
    for file in files:
        write_file(file, sweep_picture(swept(*vary)))
    one, other = (file.read_bytes() for file in files)
    assert one == other
    assert b"/CIDFontType2" in one  # Type 42
    assert b"/Type3" not in one
