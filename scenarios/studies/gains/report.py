"""Everything there is to say about one choice of steering gains: numbers as JSON, and pictures.

The numbers come from `vehicles` (stabilising sets, margins, certificate, propagation) by way of
`gains_numbers`, the pictures from `gains_pictures`; this module joins them and writes the files.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scenarios.studies.gains import numbers
from vehicles.car.parameters import Gains, Loading, VehicleParameters, all_loadings
from vehicles.theory.gain_sets import PAPER_SPEEDS

DEFAULT_SPEEDS = (*PAPER_SPEEDS[:-1], 30.0)
"""The paper's speeds (m/s), 10 to 60 mph and 30 m/s (which it equates with 67 mph)."""


def gains_report(
    parameters: VehicleParameters,
    gains: Gains,
    speeds: Sequence[float] = DEFAULT_SPEEDS,
    loadings: Sequence[Loading] | None = None,
    out_dir: Path | None = None,
    *,
    pictures: bool = True,
) -> numbers.Report:
    """Analyse `gains` on the car over `speeds` (m/s) and `loadings`; give the report as a dict.

    With `out_dir`, writes gains.json there and, unless `pictures` is false, PNG pictures (needs
    matplotlib). Paper, sections III-F, IV and V-A, V-B. The fastest speed is the reference for what
    is shown at one speed. Raises ValueError for no speed or no loading.
    """
    loadings = all_loadings() if loadings is None else loadings
    if not speeds or not loadings:
        raise ValueError("the gains report needs at least one speed and one loading")
    subject = numbers.Subject(parameters, gains, sorted(speeds), loadings)
    report: numbers.Report = {
        "gains": numbers.named(gains),
        "reference_speed_mps": subject.reference,
        "stabilising_set": numbers.stabilising_set(subject),
        "verification": numbers.verification(subject),
        "speeds": [numbers.at_speed(subject, speed) for speed in subject.speeds],
        "loadings": [numbers.at_loading(subject, loading) for loading in loadings],
        "varying_speed": numbers.varying_speed(subject),
        "propagation": [numbers.at_frequencies(subject, speed) for speed in subject.speeds],
        "pictures": [],
    }
    if out_dir is not None:
        out_dir.mkdir(parents=True, exist_ok=True)
        if pictures:
            from scenarios.studies.gains.pictures import draw_all  # noqa: PLC0415 - matplotlib is optional

            report["pictures"] = draw_all(subject, report, out_dir)
        text = json.dumps(_finite(report), indent=2, allow_nan=False)
        (out_dir / "gains.json").write_text(text + "\n", encoding="utf-8")
    return report


def _finite(value: Any) -> Any:
    """Replace what JSON cannot hold, infinity and not-a-number, by null."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return value if not isinstance(value, float) or math.isfinite(value) else None
