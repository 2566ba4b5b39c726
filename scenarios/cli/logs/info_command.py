"""`convoy info`: what a log holds."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.cli.common_options import json_option
from scenarios.cli.error_lines import clear_errors

if TYPE_CHECKING:
    from scenarios.results.log_queries.log_info import ChannelInfo, LogInfo

COLUMNS: "Sequence[Column[ChannelInfo]]" = (
    Column("channel", lambda row: row.channel, left=True),
    Column("messages", lambda row: row.messages),
    Column("rate\nHz", lambda row: row.rate_hz, ".2f"),
    Column("longest\ngap s", lambda row: row.gap_s_max, ".3f"),
    Column("bytes", lambda row: row.bytes),
    Column("missing", lambda row: row.missing),
)


@click.command(epilog="Example: convoy info runs/20260101-120000-lane_change/run.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@json_option("Print the description as JSON.")
def info(log: Path, *, as_json: bool) -> None:
    """Describe a log as a file.

    LOG is a run.mcap or its folder. Lists duration, identity, damage and missing messages, and the
    messages, rates, longest gaps and bytes of each channel.
    """
    import json
    from dataclasses import asdict

    from rich.console import Console

    from scenarios.results.log_queries.log_info import info_of
    from scenarios.results.log_summary import log_in

    with clear_errors():
        described = info_of(log_in(log))
        if as_json:
            click.echo(json.dumps(asdict(described), indent=2))
            return
        for name, text in _lines(described):
            click.echo(f"{name:<12}{text}")
        print_whole(table_of(COLUMNS, described.channels), Console())


def _lines(log: "LogInfo") -> Iterator[tuple[str, str]]:
    yield "log", f"{log.log}, {log.bytes} bytes"
    yield (
        "recorded",
        f"{log.duration_s:.2f} s, {log.messages} messages of {len(log.vehicles)} vehicles",
    )
    yield "vehicles", ", ".join(log.vehicles)
    yield "state", log.faults.removeprefix(f"{log.log}: ") or "complete"
    if log.thinned:
        yield "thinned", ", ".join(f"{topic} {rate} Hz" for topic, rate in log.thinned.items())
    for name, value in log.identity.items():
        if value not in {"", "[]", "{}"}:
            yield name, value
    yield "attached", ", ".join(f"{name} ({size} bytes)" for name, size in log.attachments.items())
