"""A notebook that uses the Python interface is executed, in a folder with confusing names."""

import os
from pathlib import Path
from typing import Any

import nbclient
import nbformat
import pytest

from tests.made.installed import arrange

CELLS = (
    "import convoy",
    "run = convoy.run(set={'duration_s': 2.0, 'links.loss_ratio': 0.4}, seed=3)\nrun",
    "true = run.vehicles['v4'].true\nworst_m = abs(true.error_m[true.station_m >= 0]).max()\n"
    "assert worst_m == run.summary.vehicles[3].cross_track_error_m_max\ntrue",
    "outcomes = run.links['v1', 'v3'].outcomes\noutcomes.to_pandas()",
    "run.plot()",
    "try:\n    convoy.run('lane_chnge')\nexcept convoy.Error as error:\n    print(error)",
    "convoy.sweep('lane_change', {'links.loss_ratio': [0.0, 0.5]}, seeds=1, workers=0,\n"
    "             set={'duration_s': 0.5, 'convoy.vehicles': 2})",
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for variable in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(variable, str(tmp_path / variable))
    work = tmp_path / "work"
    (work / "scenarios").mkdir(parents=True)
    return work


def outputs(cell: Any) -> dict[str, str]:
    (output,) = cell.outputs
    if output.output_type == "stream":
        return {"text/plain": output.text}
    return dict(output.data)


def test_a_notebook_runs_and_shows_runs(folder: Path, tmp_path: Path) -> None:
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in CELLS])
    client = nbclient.NotebookClient(
        notebook, timeout=120, resources={"metadata": {"path": str(folder)}}
    )
    client.execute(env=os.environ | {"PYTHONPATH": str(arrange(tmp_path / "site"))})
    _, run, true, outcomes, plot, error, sweep = map(_shown, notebook.cells)
    assert "lane_change" in run["text/html"]
    assert "error_m" in true["text/html"]
    assert "delay_s" in outcomes["text/html"]
    assert len(plot["image/png"]) > 10_000
    assert error["text/plain"].startswith("lane_chnge: no such file")
    assert "links.loss_ratio" in sweep["text/html"]
    assert [path.name for path in folder.iterdir() if path.name != "scenarios"] == ["runs"]


def _shown(cell: Any) -> dict[str, str]:
    return outputs(cell) if cell.outputs else {}
