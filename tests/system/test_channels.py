"""Links of real processes decide as in virtual time, message by message."""

from pathlib import Path

from tests.made.scenarios import plug_ins
from tests.system.logs import Run, assert_equal_while_nothing_was_late
from tests.system.processes import invoke, run_to_the_end, start
from vehicles.messages import LinkVerdict

EVERY_LAW = """
extends = "lane_change"
name = "every_law"
duration_s = 4.0
[links]
latency_ms = 100.0          # includes the network
jitter_ms = 15.0
outages = [{ kind = "window", from_s = 1.0, to_s = 1.2 },
           { kind = "stretch", from_m = 60.0, to_m = 66.0, vehicle = "sender" },
           { kind = "circle", east_m = 80.0, north_m = 0.0, radius_m = 5.0 },
           { kind = "random", mean_on_s = 3.0, mean_off_s = 0.1 }]
[vehicle.v2]
transmitter_off = [{ from_s = 2.0, to_s = 2.1, every_s = 1.0 }]
[vehicle.v3]
receiver_off = [{ from_s = 1.5, to_s = 1.6 }]
[[link]]
sender = "v1"
receiver = "v2"
loss = { kind = "gilbert_elliott", loss_ratio = 0.15, burst_messages_mean = 2.0 }
queue = { bytes_per_s = 1900.0, depth_messages = 2, drop = "oldest" }
[link.delay]
kind = "gamma"
mean_ms = 25.0
deviation_ms = 20.0
correlation_ratio = 0.6
order = "in_order"
[[link]]
sender = "v1"
receiver = "v3"
loss_ratio = 0.1
loss = { kind = "every_nth", every_messages = 9 }
delay = { kind = "lognormal", mean_ms = 30.0, deviation_ms = 20.0 }
[link.radio]
kind = "table"
distance_m = [0.0, 25.0, 60.0]
delivery_ratio = [1.0, 0.9, 0.2]
burst = "reservation"
[link.content]
duplicate_ratio = 0.2
reorder_ratio = 0.2
bit_error_ratio = 1e-4
false = [{ kind = "offset", left_m = 0.2, from_s = 1.0, to_s = 2.0 }]
[[link]]
sender = "v2"
receiver = "v3"
loss = { kind = "four_state", gap_to_burst_ratio = 0.05, burst_to_gap_ratio = 0.4 }
[[link.content.false]]
kind = "replayed"
age_s = 0.3
from_s = 1.0
to_s = 2.0
[[link.content.false]]
kind = "ghost"
left_m = 3.0
from_s = 3.0
[[link]]
sender = "v1"
receiver = "v4"
rate_hz = 10.0
collisions = { loss_ratio = 0.3, keep_ratio = 0.2 }
[link.radio]
kind = "path_loss"
power_dbm = 0.0
shadowing = { deviation_db = 4.0 }
obstruction = { kind = "etsi" }
[[link]]
sender = "v3"
receiver = "v4"
preset = "nlosv_3gpp_truck"
latency_ms = 100.0
radio = { power_dbm = -8.0 }
"""
Verdict = tuple[str, str, int, int, int, int, str]
"""Outcome, reason, instants after the start (ns) at which a message is sent, visible and received,
copies, and false content."""


def verdicts(run: Run) -> dict[tuple[str, str, int], Verdict]:
    """Verdicts by sender, receiver and number of the message."""
    return {
        (m.sender, m.vehicle, m.pose_seq): (
            m.outcome,
            m.reason,
            m.sent_at_ns - run.start_at,
            m.visible_at_ns - run.start_at,
            m.received_at_ns - run.start_at,
            m.copies,
            m.content,
        )
        for m in run.messages
        if isinstance(m, LinkVerdict)
    }


def run_both_clocks(arguments: tuple[str, ...], folder: Path) -> tuple[Run, Run]:
    """Run a scenario on the wall clock and in virtual time; both must succeed."""
    with start("run", *arguments, "--quiet", "--out=wall", folder=folder) as wall:
        virtual = invoke(
            "run", *arguments, "--clock=virtual", "--quiet", "--out=virtual", folder=folder
        )
        assert virtual.exit_code == 0, virtual.output
        assert wall.wait() == 0, wall.err
    return Run(folder / "wall"), Run(folder / "virtual")


def assert_same_verdicts(wall: Run, virtual: Run) -> None:
    """Compare all verdicts, up to the first late message."""
    assert_equal_while_nothing_was_late(wall, virtual, within_m=20.0)
    late = wall.late_messages_at
    actual, expected = verdicts(wall), verdicts(virtual)
    comparable = {key for key, verdict in expected.items() if not late or verdict[4] < late[0]}
    assert len(comparable) > len(expected) / 2 or late
    differ = {
        key: (actual.get(key), expected[key])
        for key in comparable
        if actual.get(key) != expected[key]
    }
    assert not differ
    if not late:
        assert actual == expected


def test_links_with_every_law_decide_alike_in_processes_and_virtual_time(tmp_path: Path) -> None:
    (tmp_path / "every_law.toml").write_text(EVERY_LAW)
    wall, virtual = run_both_clocks(("every_law.toml",), tmp_path)
    assert {verdict[1] for verdict in verdicts(virtual).values()} == {
        *("", "rate", "transmitter_off", "receiver_off", "outage", "loss", "burst", "pattern"),
        *("collision", "range", "queue", "corrupted"),
    }
    assert {verdict[6] for verdict in verdicts(virtual).values()} >= {"offset", "replayed", "ghost"}
    assert any(verdict[5] for verdict in verdicts(virtual).values())
    assert_same_verdicts(wall, virtual)


PLUGGED = """\
extends = "lane_change"
name = "plugged"
duration_s = 2.0
convoy.vehicles = 3
links.latency_ms = 60.0
"""


def test_a_run_with_all_plug_ins_equals_its_virtual_run(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(plug_ins.CODE, encoding="utf-8")
    lines = "\n".join(plug_ins.SETTINGS.values())
    (tmp_path / "own.toml").write_text(f"{PLUGGED}{lines}\n", encoding="utf-8")
    for out, clock in (("wall", "wall"), ("virtual", "virtual")):
        ran = run_to_the_end("run", "own.toml", "--clock", clock, "--out", out, folder=tmp_path)
        assert ran.exit_code == 0, ran.err
    wall, virtual = Run(tmp_path / "wall"), Run(tmp_path / "virtual")
    assert_equal_while_nothing_was_late(wall, virtual, within_m=0.05)
    assert wall.summary["plug_ins"] == virtual.summary["plug_ins"]
    assert list(wall.summary["plug_ins"]) == ["mine"]
