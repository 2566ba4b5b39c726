"""`convoy reference`: contents of logs and summaries, and the contract of a controller."""

from collections.abc import Iterable
from dataclasses import fields
from inspect import getdoc
from textwrap import fill

import click

from scenarios.cli.columns import grid_of

Row = tuple[str, ...]
WIDTH = 80


def _say(text: str) -> None:
    """Print a text, wrapped to a terminal's width but for its lists."""
    paragraphs = text.split("\n\n")
    click.echo("\n\n".join(one if "   " in one else fill(one, WIDTH) for one in paragraphs))


@click.command(
    epilog="""\b
Examples:
  convoy reference fields          of summary.json and `convoy report --json`
  convoy reference controller      what a controller of your own has to be
"""
)
@click.argument("what", type=click.Choice(["fields", "topics", "reasons", "controller"]))
def reference(what: str) -> None:
    """Explain the FIELDS of a summary, the TOPICS of a log, the REASONS for which messages are not
    used, or what a CONTROLLER of your own has to be.
    """  # noqa: D205 - the help text is one sentence
    {"fields": _fields, "topics": _topics, "reasons": _reasons, "controller": _controller}[what]()


def _print(heading: str, rows: Iterable[Row]) -> None:
    from rich.console import Console

    console = Console()
    console.print(f"\n[bold]{heading}[/]", highlight=False)
    console.print(grid_of(rows))


def _fields() -> None:
    from scenarios.results.summary import documented_fields

    _say(
        "A figure is null where there was nothing to measure. A gap between bodies takes each to "
        "reach as far beyond its front axle as beyond its rear one."
    )
    for group, docs in documented_fields().items():
        _print(group, docs.items())


def _topics() -> None:
    from transport.convoy_pb2 import Deviation
    from transport.log.foxglove import standard_messages
    from transport.topics import TOPICS

    _say(
        "Topics of run.mcap are /convoy/VEHICLE/TOPIC; /convoy/run/TOPIC is the recorder's own. "
        "The scenario (scenario.toml) and the summary (summary.json) are attachments; versions "
        "and seed are metadata. World coordinates are metres east and north of the scenario's "
        "origin, yaw is counter-clockwise from east, left is positive. Beside our messages stand "
        "those of Foxglove, which other programs can draw. Nobody sends `deviation`: it is what "
        "the recorder finds of a follower ten times a second, for plots, with the fields "
        f"{', '.join(Deviation.DESCRIPTOR.fields_by_name)}."
    )
    together = [name for name, topic in TOPICS.items() if topic.batched]
    _say(
        "On the wire messages are under convoy/VEHICLE/TOPIC, behind the name of the run; but "
        f"{', '.join(together)}, which only log and picture need, come together, ten times a "
        "second, under convoy/VEHICLE/records (the message Records of transport/convoy.proto)."
    )
    rows = [(name, topic.message.__name__, topic.meaning) for name, topic in TOPICS.items()]
    _print("topics", rows)
    beside = [
        (twin.name, f"foxglove.{twin.schema.DESCRIPTOR.name}", f"as {topic.name}")
        for topic in TOPICS.values()
        for twin in standard_messages().get(topic.message, ())
    ]
    _print("beside them", beside)
    for topic in TOPICS.values():
        message = topic.message
        click.echo()
        _say(f"{message.__name__}: {getdoc(message)}")
        _say(f"fields: {', '.join(one.name for one in fields(message))}")


def _reasons() -> None:
    from transport.reasons import REASONS

    _say("A message that was not used has a reason, in verdicts, summary and log.")
    rows = [
        (word, "link" if reason.is_drop else "receiver", counts_as(word), reason.meaning)
        for word, reason in REASONS.items()
    ]
    _print("reasons", [("reason", "given by", "counts as", "meaning"), *rows])


def counts_as(word: str) -> str:
    """Return whether a message with this reason counts as lost or as late."""
    from transport.reasons import counts_as_late, counts_as_loss

    counts = {"lost": counts_as_loss(word), "late": counts_as_late(word)}
    return ", ".join(name for name, does in counts.items() if does)


def _controller() -> None:
    from vehicles.car.parameters import Gains, VehicleParameters
    from vehicles.driver.steering import LateralController, SteeringCommand
    from vehicles.driver.tracking import TrackingErrors

    _say(getdoc(LateralController) or "")
    click.echo()
    _say(f"steer(errors, speed): {getdoc(LateralController.steer)}")
    for kind in (TrackingErrors, SteeringCommand, VehicleParameters, Gains):
        click.echo()
        _say(f"{kind.__name__}: {getdoc(kind)}")
