"""Reference page about recorded drives: formats, columns, and the keys that select a part."""

from collections.abc import Iterable

from scenarios.cli.reference.printing import print_section, print_text
from scenarios.definition.traces.formats.columns import column_names as names
from scenarios.definition.traces.formats.columns.units import SPEEDS, TIMES
from scenarios.definition.traces.formats.registry import TEXT_FORMATS

FOLDERS_AND_LOGS = (
    ("KITTI oxts", "a folder with oxts/data/*.txt and oxts/timestamps.txt"),
    ("MCAP", "a run.mcap (path.vehicle), or foxglove.LocationFix or NavSatFix (path.topic)"),
)

KEYS = (
    ("path.from_s, path.to_s", "part in seconds from the first point, as `convoy check` prints"),
    ("path.from_m, path.to_m", "the same in metres along the recorded points"),
    ("path.pauses", '"keep" waits in pauses, "cut" leaves their time out'),
    ("path.smoothing_m", "half width of the smoothing, instead of the automatic one"),
    ("vehicle.v2.replay", "a second drive, driven by v2; with replay_from_s and replay_to_s"),
)


def drives_page() -> None:
    print_text(
        "Recorded drives: `convoy check FILE` reports on one, `convoy run FILE` has the lead drive "
        "it. The content determines the format. Positions decide: unusable times, speeds and "
        "altitudes never remove a position; unusable records are left out and listed. Times "
        "without a zone are UTC."
    )
    rows = [(row.name, ", ".join(row.suffixes)) for row in TEXT_FORMATS if row.suffixes]
    print_section("formats", [*rows, *FOLDERS_AND_LOGS])
    print_section(
        "columns of CSV files",
        (
            ("latitude", _listed(names.LATITUDES)),
            ("longitude", _listed(names.LONGITUDES)),
            ("or x, y", _listed(" ".join(pair) for pair in names.PLANES)),
            ("time", _listed(names.CLOCKS)),
            ("speed", _listed(names.GROUND_SPEEDS)),
            ("altitude", _listed(names.ALTITUDES)),
        ),
        "In any case and order, with a prefix (/gps/fix/latitude) or a unit: t_ms, Speed (km/h). "
        f"Units of speed are {', '.join(SPEEDS)}; of time {', '.join(TIMES)}, else ISO 8601, or "
        "Unix time whose unit follows from its size. The header may begin with # or %; cells are "
        "separated by commas, semicolons, tabs or spaces.",
    )
    print_section("keys", KEYS)


def _listed(words: Iterable[str]) -> str:
    return ", ".join(words)
