"""Broken delays, queues and outages: one clear line each, with what was given and is allowed."""

from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import scenario_from_text
from tests.made.scenarios.messages import STRAIGHT

DELAY, OUTAGE = "links.delay", "links.outages[0]"
GAMMA = "links.delay={kind='gamma', mean_ms=20, deviation_ms=10"
NORMAL = "links.delay={kind='normal', mean_ms=20, deviation_ms=10"

BROKEN = {
    "unknown law": ("links.delay={kind='pareto'}", f"{DELAY}.kind", '"pareto"', '"lognormal"'),
    "no law": ("links.delay={mean_ms=3}", f"{DELAY}.kind", "missing", '"constant"'),
    "a number for a law": ("links.delay=20", DELAY, "given 20", "a table"),
    "no delay": ("links.delay={kind='constant'}", f"{DELAY}.delay_ms", "missing", ""),
    "a negative delay": (
        "links.delay={kind='constant', delay_ms=-1}", f"{DELAY}.delay_ms", "-1", "0 to 60000",
    ),
    "a key of another law": (f"{GAMMA}, delay_ms=3}}", f"{DELAY}.delay_ms", "unknown key", ""),
    "too much correlation": (
        f"{GAMMA}, correlation_ratio=0.999}}", f"{DELAY}.correlation_ratio", "0.999", "0 to 0.99",
    ),
    "negative correlation": (
        f"{GAMMA}, correlation_ratio=-0.5}}", f"{DELAY}.correlation_ratio", "-0.5", "0 to 0.99",
    ),
    "unknown order": (f"{GAMMA}, order='last'}}", f"{DELAY}.order", '"last"', '"in_order"'),
    "ends the wrong way": (
        "links.delay={kind='uniform', delay_ms_min=9, delay_ms_max=5}",
        f"{DELAY}.delay_ms_max", "given 5", "delay_ms_min, 9",
    ),
    "a mean that is cut off": (
        f"{NORMAL}, delay_ms_max=15}}", f"{DELAY}.delay_ms_max", "given 15", "mean_ms, 20",
    ),
    "too wide a law": (
        "links.delay={kind='lognormal', mean_ms=1, deviation_ms=6}",
        f"{DELAY}.deviation_ms", "given 6", "0.01 to 5",
    ),
    "too narrow a law": (
        "links.delay={kind='gamma', mean_ms=1000, deviation_ms=1}",
        f"{DELAY}.deviation_ms", "given 1", "10 to 5000",
    ),
    "nothing recorded": (
        "links.delay={kind='empirical'}", f"{DELAY}.file", "missing", "recorded_ms",
    ),
    "recorded twice": (
        "links.delay={kind='empirical', file='a.csv', recorded_ms=[1.0]}",
        f"{DELAY}.recorded_ms", "together with file", "one of them",
    ),
    "a file that is not there": (
        "links.delay={kind='empirical', file='a.csv'}", f"{DELAY}.file", "a.csv", "no such file",
    ),
    "a law of one link": (
        "link=[{sender='v1', receiver='v2', delay={kind='uniform', delay_ms_max=0}}]",
        "link[0].delay.delay_ms_max", "given 0", "delay_ms_min, 0",
    ),
    "a recorded delay below zero": (
        "links.delay={kind='empirical', recorded_ms=[3.0, -1.0]}",
        f"{DELAY}.recorded_ms[1]", "given -1", "0 to 60000",
    ),
    "too many recorded delays": (
        f"links.delay={{kind='empirical', recorded_ms={[1.0] * 1001}}}",
        f"{DELAY}.recorded_ms", "given [1.0", "at most 1000",
    ),
    "no rate of a queue": ("links.queue={}", "links.queue.bytes_per_s", "missing", ""),
    "a queue that stands": (
        "links.queue={bytes_per_s=0}", "links.queue.bytes_per_s", "given 0", "1 to 1000000000",
    ),
    "no room in a queue": (
        "links.queue={bytes_per_s=9, depth_messages=0}",
        "links.queue.depth_messages", "given 0", "1 to 10000",
    ),
    "dropped at random": (
        "links.queue={bytes_per_s=9, drop='any'}", "links.queue.drop", '"any"', '"oldest"',
    ),
    "unknown outage": ("links.outages=[{kind='fog'}]", f"{OUTAGE}.kind", '"fog"', '"window"'),
    "one outage without its list": (
        "links.outages={kind='window'}", "links.outages", "given a table", "a list",
    ),
    "a window without end": (
        "links.outages=[{kind='window', from_s=1}]", f"{OUTAGE}.to_s", "missing", "",
    ),
    "a window that ends first": (
        "links.outages=[{kind='window', from_s=3, to_s=3}]", f"{OUTAGE}.to_s", "3", "from_s, 3",
    ),
    "a window longer than its period": (
        "links.outages=[{kind='window', from_s=3, to_s=9, every_s=5}]",
        f"{OUTAGE}.every_s", "given 5", "from_s, 6",
    ),
    "a stretch that ends first": (
        "links.outages=[{kind='stretch', from_m=30, to_m=-3}]",
        f"{OUTAGE}.to_m", "given -3", "from_m, 30",
    ),
    "nobody's stretch": (
        "links.outages=[{kind='stretch', from_m=3, to_m=30, vehicle='lead'}]",
        f"{OUTAGE}.vehicle", '"lead"', '"either"',
    ),
    "a circle nowhere": (
        "links.outages=[{kind='circle', radius_m=3}]", f"{OUTAGE}.east_m", "missing", "latitude",
    ),
    "half a place": (
        "links.outages=[{kind='circle', radius_m=3, north_m=3}]",
        f"{OUTAGE}.east_m", "missing", "north_m",
    ),
    "a place twice": (
        "links.outages=[{kind='circle', radius_m=3, north_m=3, east_m=1, latitude_deg=3,"
        " longitude_deg=3}]",
        f"{OUTAGE}.latitude_deg", "together with east_m", "one of them",
    ),
    "a place on another continent": (
        "links.outages=[{kind='circle', radius_m=3, latitude_deg=3, longitude_deg=3}]",
        f"{OUTAGE}.latitude_deg", "given 3", "100 km",
    ),
    "a circle without width": (
        "links.outages=[{kind='circle', radius_m=0, north_m=3, east_m=1}]",
        f"{OUTAGE}.radius_m", "given 0", "more than 0",
    ),
    "never on": (
        "links.outages=[{kind='random', mean_on_s=0, mean_off_s=1}]",
        f"{OUTAGE}.mean_on_s", "given 0", "0.001 to 86400",
    ),
    "a transmitter off the wrong way": (
        "vehicle.v2.transmitter_off=[{from_s=2, to_s=1}]",
        "vehicle.v2.transmitter_off[0].to_s", "given 1", "from_s, 2",
    ),
    "a receiver off for ever": (
        "vehicle.v2.receiver_off=true", "vehicle.v2.receiver_off", "given true", "a list",
    ),
}  # fmt: skip


def error_lines(change: str, folder: Path | None = None) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(STRAIGHT, label="a.toml", overrides=[change], folder=folder)
    return list(caught.value.lines)


@pytest.mark.parametrize(("change", "key", "given", "allowed"), BROKEN.values(), ids=BROKEN)
def test_an_invalid_value_gets_one_line(change: str, key: str, given: str, allowed: str) -> None:
    line = next(line for line in error_lines(change) if f" {key}: " in line)
    assert line.startswith("--set: ")
    assert given in line
    assert allowed in line
    assert "\n" not in line
    assert len(line) < 250


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no column delay_ms"),
        ("t_s,delay_s\n1,2\n", "no column delay_ms"),
        ("delay_ms\n", "no delays, allowed one or more"),
        ("delay_ms\n3\nfast\n", "line 3: delay_ms is 'fast', allowed 0 to 60000"),
        ("t_s,delay_ms\n3\n", "line 2: delay_ms is '', allowed"),
        ("delay_ms\n-1\n", "line 2: delay_ms is '-1', allowed"),
        ("delay_ms\nnan\n", "line 2: delay_ms is 'nan', allowed"),
    ],
)
def test_a_file_of_delays_is_refused_with_its_line(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    (line,) = error_lines("links.delay={kind='empirical', file='a.csv'}", tmp_path)
    assert "links.delay.file: a.csv: " in line
    assert why in line
