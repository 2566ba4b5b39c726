"""Reference page about recorded drives: formats, columns, and the keys that select a part."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from importlib.resources import files
from inspect import getdoc

import click

from scenarios.cli.table_keys import Row, print_section, print_text
from scenarios.definition.traces.formats import column_names as names
from scenarios.definition.traces.formats.column_names import SPEEDS, TIMES
from scenarios.definition.traces.formats.registry import TEXT_FORMATS
from scenarios.results.frequency_gains import LEAST_COHERENCE, LEAST_RMS
from scenarios.results.string_figures import LEAST_ACCELERATION_MPS2, LEAST_ERROR_M, SIGMAS
from scenarios.results.summary import documented_fields
from scenarios.runs.processes.membership import SEPARATOR, Fingerprint
from scenarios.runs.stop import EXIT_CODES
from transport.log.foxglove import standard_messages
from transport.topics import (
    REASONS,
    RUN_SENDER,
    TOPICS,
    alive_key,
    clock_key,
    control_key,
    counts_as_late,
    counts_as_loss,
    end_key,
    key,
)
from vehicles.messages import MODES, RunEnd, RunStart

FOLDERS_AND_LOGS = (
    ("MCAP", "a run.mcap (path.vehicle), or LocationFix, NavSatFix, Odometry, PoseStamped"),
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


# ---- Reference pages about summaries, intervals and exit codes


def fields_page() -> None:
    print_text(
        "Fields of summary.json and of `convoy report --json`. A field is null where nothing was "
        "measured."
    )
    for group, docs in documented_fields().items():
        print_section(group, docs.items())


def intervals_page() -> None:
    print_text(
        "Intervals of studies, and the share of repetitions in which they contained a known truth."
    )
    for heading, (text, rows) in INTERVALS.items():
        print_section(heading, rows.items(), text)


INTERVALS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "bisect, 95 %": (
        "The share of broken runs is fitted by a logistic curve: the posterior of the boundary on "
        "a grid, with a uniform prior in the boundary and in the logarithm of the width. Each run "
        "has its own seed. A quarter of the runs so far is added at five quantiles of the "
        "boundary, until the interval is narrow enough and 20 broken and 20 kept runs are expected "
        "at the share: 400 runs for 5 %. Rows: share, and width of a logistic curve as a part of "
        "the range; repetitions with boundaries from 0.2 to 0.8 of the range and default options.",
        {
            "50 %": "93 to 98 %; 50 runs at a width of 0.005, 211 at 0.05, 934 at 0.15",
            "5 or 95 %": "93 to 96 %; 478 runs at a width of 0.005, 770 at 0.05, 1000 at 0.15",
            "step, 50 %": "97 %, 50 runs",
            "other curves": "88 to 100 %: probit, complementary log-log, log-log and Weibull",
        },
    ),
    "sweep, 95 %": (
        "Shares of broken limits: Agresti-Coull. Means: Student's t; those of gains are geometric, "
        "by their logarithms. Medians and quantiles have no interval.",
        {"shares, any": "at least 92 % from 10 runs on; 89 % with 5"},
    ),
    "compare, 99 %": (
        "Means over seeds: Student's t of pairs with equal seeds, else Welch's. Counts that are "
        "equal in all runs of a side get the spread of one more run that differs by one.",
        {
            "normal, Gumbel": "98.7 to 99.7 % with 2 to 20 runs a side",
            "log-normal, equal": "99.2 to 99.8 %",
            "log-normal, different": "91 to 98 %",
            "events of equal rates": "99 to 100 %",
        },
    ),
}
"""Text and rows by heading; tests/scenarios/studies/many/boundary/test_curve.py has the first."""


def exit_codes_page() -> None:
    print_text("Exit codes of all commands.")
    print_section("exit codes", [(str(code), meaning) for code, meaning in EXIT_CODES.items()])


# ---- Reference page about string stability


def string_stability_page() -> None:
    print_text(
        "String stability: whether errors grow from vehicle to vehicle. The figures are in "
        "vehicles[].string of summary.json, in `convoy report`, in `run.string_errors` of Python, "
        "and by name in `sweep --metric`, such as v6.string.spacing_gain_l2_from_first. Limits on "
        "them are in `convoy reference limits`."
    )
    for heading, (text, rows) in SECTIONS.items():
        print_section(heading, rows.items(), text)


Section = tuple[str, Mapping[str, str]]
SECTIONS: Mapping[str, Section] = {
    "signals": (
        "All vehicles are compared over the same places or times, so that ratios of root mean "
        "squares are ratios of L2 norms, and ratios of largest magnitudes are ratios of L∞ norms.",
        {
            "lateral": "true offset e_i(s) of follower i from the path that the lead drove, at "
            "equal arc length s, over the path that all followers drove. Lead: none.",
            "spacing": "spacing error δ_i(t) of a follower that keeps a gap (speed.followers = "
            '"gap"): arc length to the vehicle ahead along the path of the lead, minus the desired '
            "one, speed.gap.standstill_m + headway_s · own speed. Positive if the gap is too wide. "
            "Lead: none.",
            "acceleration": "true longitudinal acceleration a_i(t), also of the lead.",
        },
    ),
    "gains": (
        "Each is a norm of the output over the same norm of the input, for L2 and for L∞.",
        {
            "*_gain_l2, *_gain_linf": "output: signal of vehicle i; input: the same signal of the "
            "vehicle ahead, i - 1. The first follower has one of the acceleration only.",
            "*_from_first": "output: lateral or spacing error of vehicle i; input: that of the "
            "first follower. Of the last vehicle it is the head-to-tail gain.",
            "*_from_lead": "output: acceleration of vehicle i; input: acceleration of the lead, "
            "the disturbance. Of the last vehicle it is the head-to-tail gain.",
            "v3 over v2": "v2 follows the lead, whose speed control announces its acceleration one "
            "control period earlier than a follower's law. With laws that use it, such as Ploeg's, "
            "the spacing error of v2 is smaller for that reason, and the first gain is large.",
            "*_growth_l2": "geometric mean of the gains per vehicle from the head to vehicle i: "
            "the gain from the head to the power of 1 / number of vehicles between.",
        },
    ),
    "definitions": (
        "A run shows the response to its disturbance, not the supremum over all of them: a gain "
        "above 1 refutes string stability in that sense, gains below 1 do not prove it.",
        {
            "Swaroop and Hedrick": "(1996): all spacing errors stay bounded, and converge, for "
            "small initial errors. Errors that do not grow along the string, gains ≤ 1 in L∞, are "
            "sufficient.",
            "Ploeg et al.": "(2014): L_p string stability: the norm of every vehicle's output is "
            "bounded by the lead's input, whatever the length. Strict: gain from vehicle to "
            "vehicle at most 1, here *_gain_l2 or *_gain_linf. Semi-strict: gain from the first "
            "vehicle to each other one at most 1, here *_from_first and *_from_lead.",
            "Feng et al.": "(2019), a survey: weak string stability is the gain from head to tail, "
            "strong (strict) string stability that of every pair. A string may amplify between two "
            "vehicles and still attenuate from head to tail.",
        },
    ),
    "no figure": (
        "A gain is left out where its input is at the level of the noise: the ratio would compare "
        "noise with noise.",
        {
            "lateral": "root mean square of the input (L2) below σ, or largest value (L∞) below "
            f"{SIGMAS:g} σ, where σ is the larger of the receiver's stated and the vehicle's "
            f"estimated standard deviation of the position of the vehicle ahead, at its worst, and "
            f"at least {LEAST_ERROR_M * 1000:g} mm; no gain if neither is recorded",
            "spacing": "the same with √2 σ, since two positions are measured",
            "acceleration": f"root mean square below {LEAST_ACCELERATION_MPS2:g} m/s², or largest "
            f"value below {SIGMAS * LEAST_ACCELERATION_MPS2:g} m/s²",
            "all": "less than 40 m or 0.4 s in common, such as behind a vehicle that failed early",
        },
    ),
    "gains by frequency": (
        "`run.frequency_gains()` in Python and a picture of `convoy report --html`: gain and phase "
        "from the speed (or spacing error) of the vehicle ahead to that of a vehicle, from the "
        "cross spectrum over the spectrum of the input (H1), averaged over five Fourier "
        "coefficients of the whole run, whose last fifth is faded out; a run that does not begin "
        "at constant speed, such as a part of a log, has a Hann window. A pulse that has faded by "
        "the end of a run from constant speed on, and a steady oscillation, are exact up to noise; "
        "the interval has a confidence of 95 % (Bendat and Piersol, Random Data).",
        {
            "excitation": "the input has a root mean square of at least "
            f"{LEAST_RMS['speed']:g} m/s² (spacing: {LEAST_RMS['spacing'] * 100:g} cm), and the "
            "band 1 % of the power of the strongest one; else nothing is given",
            "coherence": f"at least {LEAST_COHERENCE:g}; else nothing is given",
        },
    ),
}


# ---- Reference pages about messages: topics, wire, reasons, .proto


RUN_MESSAGES = RunStart, RunEnd
"""Messages that the recorder publishes for the whole run."""


def topics_page() -> None:
    print_text(
        "Topics of run.mcap are /convoy/VEHICLE/TOPIC. The recorder's own are /convoy/run/TOPIC. "
        "The scenario (scenario.toml) and the summary (summary.json) are attachments; versions and "
        "seed are metadata. World coordinates are metres east and north of the scenario's origin. "
        "Yaw is counter-clockwise from east. Left is positive. The log also holds standard "
        "Foxglove messages, which other programs can draw."
    )
    rows = [(name, topic.message.__name__, topic.meaning) for name, topic in TOPICS.items()]
    print_section("topics", rows)
    print_section("modes of a vehicle", MODES.items())
    print_section("Foxglove messages", standard_rows())
    for topic in TOPICS.values():
        click.echo()
        print_text(f"{topic.message.__name__}: {getdoc(topic.message)}")
        print_text(f"fields: {', '.join(one.name for one in fields(topic.message))}")


def standard_rows() -> Iterator[Row]:
    """Foxglove messages in the log: topic, schema, and the topic that they are made from."""
    for topic in TOPICS.values():
        for one in standard_messages().get(topic.message, ()):
            yield one.name, one.kind.DESCRIPTOR.full_name, f"from {topic.name}"


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
