"""Formats of plots, and labels of their axes."""

from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from scenarios.definition.errors import ScenarioError
from scenarios.results.figure_style import STYLE, picture_format_of
from scenarios.studies.job import write_file
from scenarios.studies.many.pictures import axis_label

BEGINS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@mpl.rc_context(STYLE)
def a_figure() -> Figure:
    figure = Figure()
    figure.subplots().plot([0.0, 1.0], [1.0, 0.0])
    return figure


@pytest.mark.parametrize("picture_format", BEGINS)
def test_equal_figures_give_equal_files(tmp_path: Path, picture_format: str) -> None:
    files = [tmp_path / f"{name}.{picture_format}" for name in ("one", "other")]
    for file in files:
        write_file(file, a_figure())
    one, other = (file.read_bytes() for file in files)
    assert one == other
    assert one.startswith(BEGINS[picture_format])


@pytest.mark.parametrize("name", ["a.gif", "a"])
def test_another_extension_is_refused_with_those_allowed(name: str) -> None:
    with pytest.raises(ScenarioError, match=r"allowed \.png, \.svg, \.pdf"):
        picture_format_of(Path(name))


@pytest.mark.parametrize(
    ("name", "text", "factor"),
    [
        ("links.loss_ratio", "loss of all links, %", 100.0),
        ("convoy.gap_m", "gap, m", 1.0),
        ("gnss.rate_hz", "rate (gnss), Hz", 1.0),
        ("links.queue.bytes_per_s", "bytes (links.queue), 1/s", 1.0),
        ("path.curvature_per_m", "curvature (path), 1/m", 1.0),
        ("links.preset", "preset of all links", 1.0),
        ("cross_track_error_m_max", "largest cross-track error, m", 1.0),
        ("true_gap_m_min", "smallest true gap, m", 1.0),
        ("v3.distance_m", "distance (v3), m", 1.0),
        ("speed.acceleration_mps2_max", "largest acceleration (speed), m/s²", 1.0),
    ],
)
def test_labels_have_words_and_units(name: str, text: str, factor: float) -> None:
    label = axis_label(name)
    assert (label.text, label.factor) == (text, factor)
