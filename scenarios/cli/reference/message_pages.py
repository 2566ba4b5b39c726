"""Reference pages about messages: topics, wire, reasons, .proto."""

from collections.abc import Iterator
from dataclasses import fields
from importlib.resources import files
from inspect import getdoc

import click

from scenarios.cli.reference.printing import Row, print_section, print_text
from scenarios.runs.processes.membership import SEPARATOR, Fingerprint
from transport.convoy_pb2 import Deviation
from transport.log.foxglove import standard_messages
from transport.reasons import REASONS, counts_as_late, counts_as_loss
from transport.topics import RUN_SENDER, TOPICS, alive_key, clock_key, control_key, end_key, key
from vehicles.messages import MODES, RunEnd, RunStart

RUN_MESSAGES = RunStart, RunEnd
"""Messages that the recorder publishes for the whole run."""
DEVIATION_ROW = "deviation", "Deviation", "true error and gap of a follower, ten times a second"
"""Topic that only the log has."""


def topics_page() -> None:
    print_text(
        "Topics of run.mcap are /convoy/VEHICLE/TOPIC. The recorder's own are /convoy/run/TOPIC. "
        "The scenario (scenario.toml) and the summary (summary.json) are attachments; versions and "
        "seed are metadata. World coordinates are metres east and north of the scenario's origin. "
        "Yaw is counter-clockwise from east. Left is positive. The log also holds standard "
        "Foxglove messages, which other programs can draw."
    )
    rows = [(name, topic.message.__name__, topic.meaning) for name, topic in TOPICS.items()]
    print_section("topics", [*rows, DEVIATION_ROW])
    print_section("modes of a vehicle", MODES.items())
    print_section("Foxglove messages", standard_rows())
    for topic in TOPICS.values():
        click.echo()
        print_text(f"{topic.message.__name__}: {getdoc(topic.message)}")
        print_text(f"fields: {', '.join(one.name for one in fields(topic.message))}")
    click.echo()
    print_text("Deviation: True error and gap of a follower. The recorder computes them for plots.")
    print_text(f"fields: {', '.join(Deviation.DESCRIPTOR.fields_by_name)}")


def standard_rows() -> Iterator[Row]:
    """Foxglove messages in the log: topic, schema, and the topic that they are made from."""
    for topic in TOPICS.values():
        for one in standard_messages().get(topic.message, ()):
            yield one.name, one.schema.name, f"from {topic.name}"


def wire_page() -> None:
    print_text(
        "Keys of a run on Zenoh. All keys have the prefix RUN/, the name of the run (--run). A "
        "message is encoded as Protobuf, in the schema of `convoy reference .proto`, and declares "
        'the encoding "application/protobuf;convoy.MESSAGE". Impairments act in the receiver: '
        "the wire carries every message."
    )
    print_section("messages", wire_messages())
    print_section("queries and tokens", wire_queries())
    click.echo()
    parts = SEPARATOR.join(entry.name for entry in fields(Fingerprint))
    print_text(
        f"FINGERPRINT is {parts}: name, seed, "
        "version of the program, digests of the scenario's content, of the program's sources and "
        "of the modules of user-defined classes, versions of Python and NumPy. Only the versions "
        "of Python and NumPy may differ between processes of a run. "
        "SESSION is the Zenoh identifier of the process."
    )
    click.echo()
    print_text(
        "A request to a vehicle is JSON: one entry of [[change]] without at_s, such as "
        '{"kind": "cut", "sender": "v1", "for_s": 2}. An empty object returns the earliest '
        "time at which a change can take effect. The recorder answers an empty request with "
        "the status of the run, as `convoy status --once --json` prints it."
    )
    click.echo()
    print_text(
        "RUN_ID keeps runs of the same name apart. It is random, the NAME of the recorder's token, "
        "and the run_id of the start and the end. A query with RUN_ID has it in its first line, "
        "before the content described above. Starts and ends of another run are ignored "
        "and counted as foreign; its queries get no answer."
    )
    click.echo()
    print_text(
        "Who may read and write is decided by Zenoh's TLS and access rules (--config, --cfg): any "
        "program that reaches the router can send poses in the name of a vehicle."
    )
    click.echo(
        f"\nExample, listen.py, whose argument is the router's endpoint:\n\n{LISTENER}", nl=False
    )


LISTENER = """\
import sys, time, zenoh
from transport.convoy_pb2 import GpsPose


def show(sample):
    pose = GpsPose.FromString(sample.payload.to_bytes())
    print(pose.vehicle, pose.seq, pose.latitude_deg, pose.longitude_deg)


config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
with zenoh.open(config) as session:
    session.declare_subscriber("*/convoy/*/gps", show)
    time.sleep(10)
"""
"""A program that prints the poses of a running convoy; a test runs it."""


def wire_messages() -> Iterator[Row]:
    for topic in TOPICS.values():
        if not topic.batched:
            sender = RUN_SENDER if topic.message in RUN_MESSAGES else "VEHICLE"
            yield f"RUN/{key(sender, topic)}", topic.message.__name__, topic.meaning
    batched = ", ".join(name for name, topic in TOPICS.items() if topic.batched)
    yield "RUN/convoy/VEHICLE/records", "Records", f"ten times a second: {batched}"


def wire_queries() -> Iterator[Row]:
    token = alive_key("ROLE", "NAME", "FINGERPRINT", "SESSION")
    yield f"RUN/{token}", "liveliness token of a process; ROLE is vehicle or recorder"
    yield (
        f"RUN/{clock_key(RUN_SENDER)}",
        "query with RUN_ID: MARK, perhaps with a second line VEHICLE OFFSET UNCERTAINTY of the "
        "sender's clock in ns; the answer is \"MARK TIME\", the recorder's clock in ns",
    )
    yield f"RUN/{end_key(RUN_SENDER)}", "query with RUN_ID: VEHICLE confirms the end of a run"
    yield f"RUN/{control_key('VEHICLE')}", "query with RUN_ID: change a running vehicle"
    yield f"RUN/{control_key(RUN_SENDER)}", "query: status of the run, from the recorder"


def reasons_page() -> None:
    print_text(
        "Reasons for which a message was not used, in verdicts, summary and log. A link drops "
        "messages; a receiver refuses them. Lost messages count in the loss ratio of the link, "
        "late ones in the late messages of the receiver. All others are only counted by reason."
    )
    rows = [
        (word, "link" if reason.is_drop else "receiver", counts_as(word), reason.meaning)
        for word, reason in REASONS.items()
    ]
    print_section("reasons", [("reason", "given by", "counts as", "meaning"), *rows])


def counts_as(word: str) -> str:
    counts = {"lost": counts_as_loss(word), "late": counts_as_late(word)}
    return ", ".join(name for name, does in counts.items() if does)


def proto_page() -> None:
    text = (files("transport") / "convoy.proto").read_text(encoding="utf-8")
    click.echo(text, nl=False)
