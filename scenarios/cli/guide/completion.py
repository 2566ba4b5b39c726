"""Shell completion of scenarios; Click completes commands and options itself.

Each press of Tab starts a process, so imports are lazy.
"""

from pathlib import Path

from click import Context, Parameter
from click.shell_completion import CompletionItem

OWN_FILES = (".toml", ".csv", ".geojson", ".gpx", ".kml", ".mcap", ".nmea", ".pos")
"""Suffixes of scenarios and recorded drives."""


def scenarios(_context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    from scenarios.definition.library import library

    own = sorted(path.name for path in Path().iterdir() if path.suffix.lower() in OWN_FILES)
    known = [one for one in (*library(), *own) if one.startswith(incomplete)]
    return [CompletionItem(one) for one in known] or [CompletionItem(incomplete, type="file")]
