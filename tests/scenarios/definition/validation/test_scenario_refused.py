"""Broken scenario files: one clear line each, with file, key, what was given, what is allowed."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from tests.made.examples import examples
from tests.made.scenarios.messages import STRAIGHT


def refused(text: str, *overrides: str, folder: Path | None = None) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(text, label="a.toml", overrides=overrides, folder=folder)
    return list(caught.value.lines)


BROKEN_BY_OVERRIDE = {
    "wrong type": ("duration_s='long'", "duration_s", 'given "long"', "a number"),
    "boolean for a number": ("speed.set_mps=true", "speed.set_mps", "given true", "a number"),
    "fraction of a vehicle": ("convoy.vehicles=2.5", "convoy.vehicles", "2.5", "a whole number"),
    "text for a list": ("path.segments='x'", "path.segments", 'given "x"', "a list"),
    "value for a table": ("control=3", "control", "given 3", "a table"),
    "wrong unit": ("links.latency_s=0.02", "links.latency_s", "unknown", "links.latency_ms = 20?"),
    "per cent": (
        "links.loss_percent=5",
        "links.loss_percent",
        "unknown",
        "links.loss_ratio = 0.05?",
    ),
    "misspelt key": ("convoy.vehicels=3", "convoy.vehicels", "unknown", "convoy.vehicles?"),
    "key of another table": ("alpha_ratio=1", "alpha_ratio", "unknown", "control.alpha_ratio?"),
    "negative rate": ("control.rate_hz=-50", "control.rate_hz", "given -50", "5 to 500"),
    "no rate": ("gnss.rate_hz=0", "gnss.rate_hz", "given 0", "0.01 to 100"),
    "too much loss": ("links.loss_ratio=1.5", "links.loss_ratio", "given 1.5", "0 to 1"),
    "negative latency": ("links.latency_ms=-1", "links.latency_ms", "given -1", "0 to 60000"),
    "not a number": ("speed.set_mps=nan", "speed.set_mps", "given nan", "a finite number"),
    "infinity": ("convoy.gap_m=inf", "convoy.gap_m", "given inf", "a finite number"),
    "unknown choice": ("control.fusion='both'", "control.fusion", '"both"', '"composite"'),
    "unknown path": ("path.kind='road'", "path.kind", 'given "road"', '"segments", "trace"'),
    "antiquity": (
        "start_at=0001-01-01T00:00:00Z",
        "start_at",
        "0001-01-01T",
        "at least 1970-01-01",
    ),
    "too late": (
        "start_at=2262-04-12T00:00:00Z",
        "start_at",
        "2262-04-12T",
        "less than 2200-01-01",
    ),
    "local time": ("start_at=2026-01-01T00:00:00", "start_at", "2026", "with its zone"),
    "empty road": ("path.segments=[]", "path.segments", "given []", "at least one entry"),
    "impossible name": ("convoy.names=['a/b']", "convoy.names[0]", '"a/b"', "a letter first"),
    "two of one name": ("convoy.names=['a','b','a']", "convoy.names[2]", 'given "a"', "names[0]"),
    "the launcher's name": ("convoy.names=['run']", "convoy.names[0]", 'given "run"', "launcher"),
    "unknown vehicle": ("vehicle.v9.gap_m=3", "vehicle.v9", "no such", "v1, v2, v3, v4"),
    "gap of the lead": ("vehicle.v1.gap_m=3", "vehicle.v1.gap_m", "lead", "no predecessor"),
    "link to nobody": (
        "link=[{sender='v1', receiver='v7'}]",
        "link[0].receiver",
        'given "v7"',
        '"follower", "*"',
    ),
    "link without a receiver": (
        "link=[{sender='v3', receiver='v2'}]",
        "link[0]",
        "v3",
        "no such link",
    ),
    "touching bumpers": ("convoy.gap_m=0", "convoy.gap_m", "given 0", "more than 0"),
    "path too short": ("duration_s=51", "duration_s", "given 51", "at most 50"),
    "profile without points": ("speed.lead='profile'", "speed.profile", "missing", "profile"),
    "nothing recorded": ("speed.lead='recorded'", "speed.lead", "recorded", "times"),
    "radius without turn": (
        "path.segments.0.radius_m=50",
        "path.segments[0].turn",
        "missing",
        "radius_m",
    ),
    "unknown controller": ("control.controller='pid'", "control.controller", "pid", '"stanley"'),
    "not an override": ("seed", "seed", "given", "key=value"),
    "key below a value": ("duration_s.x=1", "duration_s", "is a value", "no key x"),
    "too seldom": ("gnss.rate_hz=1e-320", "gnss.rate_hz", "given 1e-320", "0.01 to 100"),
    "too stiff a car": (
        "parameters.yaw_inertia_kgm2=11",
        "parameters",
        "7.27e+04 1/s",
        "allowed up to 20000",
    ),
    "too long a road": (
        "path={kind='segments', segments=[{length_m=90000.0}], laps=12}",
        "path.laps",
        "1080 km of road",
        "at most 1000 km",
    ),
    "endless number": (
        f"seed=0x{'f' * 5000}",
        "seed",
        "a number without end",
        "0 to 9223372036854775807",
    ),
    "entry too far": ("path.segments.7.length_m=1", "path.segments", "index 7", "0 to 1"),
}


@pytest.mark.parametrize(
    ("change", "key", "given_", "allowed"), BROKEN_BY_OVERRIDE.values(), ids=BROKEN_BY_OVERRIDE
)
def test_an_invalid_value_gets_one_line(change: str, key: str, given_: str, allowed: str) -> None:
    (line,) = refused(STRAIGHT, change)
    assert line.startswith(("--set", "a.toml: "))
    assert key in line
    assert given_ in line
    assert allowed in line
    assert "\n" not in line
    assert len(line) < 250


BROKEN_TEXT = {
    "not TOML": ("name = \n", "not valid TOML", "line 1"),
    "a key twice": ("name = 'a'\nname = 'b'\n", "not valid TOML", "line 2"),
    "no path": ("name = 'a'\n", "path", "missing"),
    "no kind of path": ("name = 'a'\n[path]\nfile = 'x.csv'\n", "path.kind", "missing"),
    "no name": (STRAIGHT.replace('name = "straight"', ""), "name", "missing"),
    "unequal lists": (
        "name = 'a'\n[path]\nkind = 'points'\neast_m = [0, 1]\nnorth_m = [0]\n",
        "path.north_m",
        "allowed 2",
    ),
    "laps of an open drive": (
        "name = 'a'\n[path]\nkind = 'trace'\nfile = 'x.csv'\nlaps = 2\n",
        "path.laps",
        "path.closed = true",
    ),
    "profile out of order": (
        STRAIGHT
        + "[speed]\nlead = 'profile'\n"
        + "profile = [{at_s = 1.0, speed_mps = 5.0}, {at_s = 1.0, speed_mps = 6.0}]\n",
        "speed.profile[1].at_s",
        "allowed more than 1",
    ),
    "a lead that never arrives": (
        STRAIGHT.replace("duration_s = 20.0\n", "")
        + "[speed]\nlead = 'profile'\nprofile = [{at_s = 0.0, speed_mps = 0.0}]\n",
        "duration_s",
        "does not reach the end",
    ),
    "trace that is not there": (
        "name = 'a'\n[path]\nkind = 'trace'\nfile = 'missing.csv'\n",
        "path.file",
        "no such file",
    ),
    "trace with a zero byte in its name": (
        "name = 'a'\n[path]\nkind = 'trace'\nfile = \"a\\u0000b\"\n",
        "path.file",
        "embedded null",
    ),
    "points that are none": (
        "name = 'a'\n[path]\nkind = 'points'\neast_m = []\nnorth_m = []\n",
        "path",
        "point",
    ),
    "a record of ages": (
        "name = 'a'\n[speed]\nlead = 'recorded'\n[path]\nkind = 'points'\n"
        f"east_m = {[9 * k for k in range(9)]}\nnorth_m = {[0] * 9}\n"
        f"time_s = {[-1e308, *[0.0] * 7, 1e308]}\n",
        "path.time_s",
        "recorded times span inf s, allowed at most 86400",
    ),
    "trace with too long a name": (
        f"name = 'a'\n[path]\nkind = 'trace'\nfile = '{'x' * 300}.csv'\n",
        "path.file",
        "file name too long",
    ),
}


@pytest.mark.parametrize(("text", "key", "why"), BROKEN_TEXT.values(), ids=BROKEN_TEXT)
def test_an_invalid_file_gets_one_line(text: str, key: str, why: str) -> None:
    line = next(line for line in refused(text) if f" {key}" in line or key in line.split(": ")[1])
    assert line.startswith("a.toml: ")
    assert key in line
    assert why in line


@examples(22, 200)
@given(
    key=st.sampled_from(
        [
            *("name", "seed", "duration_s", "start_at", "origin.latitude_deg", "control.rate_hz"),
            *("convoy.vehicles", "convoy.names", "convoy.gap_m", "control.controller", "gnss"),
            *("speed.lead", "speed.set_mps", "speed.profile", "speed.followers", "links.rate_hz"),
            *("path", "path.kind", "path.laps", "path.segments.0.length_m", "link", "vehicle.v2"),
            *("vehicle.v1.control", "parameters.length_m", "loading.rear_passengers"),
        ]
    ),
    value=st.sampled_from(
        [
            *("0", "-1", "1", "7", "1e308", "1e-308", "nan", "inf", "true", "'x'", "'*'", "'gap'"),
            *("'profile'", "[]", "[{}]", "{}", "{a=1}", "[{at_s=0.0, speed_mps=0.0}]"),
            *("['a', 'b']", "0001-01-01T00:00:00Z", "9999-12-31T23:59:59Z", "1979-05-27"),
        ]
    ),
)
def test_no_value_of_any_key_gives_anything_but_a_scenario_or_clear_lines(
    key: str, value: str
) -> None:
    lines: tuple[str, ...] = ()
    try:
        scenario = scenario_from_text(STRAIGHT, overrides=[f"{key}={value}"])
        assert scenario_from_text(scenario.text).tables == scenario.tables
    except ScenarioError as error:
        lines = error.lines or ("",)
    assert all(line and line.isprintable() and len(line) < 300 for line in lines)


def test_every_problem_of_a_file_has_its_line() -> None:
    text = STRAIGHT + "[convoy]\nvehicles = 0\ngap = 3.0\n[links]\nloss_ratio = 2\n"
    lines = refused(text, "seed=-1")
    assert len(lines) == 4
    assert [line.split(":")[0] for line in lines] == ["--set", "a.toml", "a.toml", "a.toml"]


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("missing.toml", None, "no such file"),
        ("empty.toml", b" \n", "empty file"),
        ("binary.toml", bytes(range(128, 256)), "not a text file, byte 0 is not UTF-8"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, why: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(tmp_path / name)
    (line,) = caught.value.lines
    assert name in line
    assert why in line


ODD_FILES = (
    *(
        b"",
        b" \n",
        b"\0" * 100,
        b"\xff\xfe" + "name = 'a'".encode("utf-16-le"),
        b"name = 'caf\xe9'",
    ),
    *(b"x = " + b"[" * 5000, b"a." * 5000 + b"a = 1", b"name = 'a'\nname = 'b'", b"[path", b"= 1"),
    *(
        b"seed = " + b"9" * 5000,
        b"seed = 0x" + b"f" * 5000,
        b'name = "\\u0000"',
        b"[[path]]\n[path]",
    ),
    *(b'extends = "broken.toml"', b'extends = "."', b"extends = 3", b'extends = "a\\u0000b"'),
    *(b'extends = "nobody.toml"', b'extends = "' + b"a" * 5000 + b'"', b"\x89MCAP0\r\n", b"{}"),
    *(b"name = 'a'\r" * 2, b"\xef\xbb\xbf", b"path.kind = 1", b"vehicle = []", b"vehicle.v1 = 3"),
    *(b"[control]\ncontroller = 'os.path'", b"[control]\ncontroller = '..'", b"name = 1979-05-27"),
)
ODD_OVERRIDES = (
    *("", "=", "=1", "a", "a.b", ".=1", "links.=1", "links..loss_ratio=0", "name.x=1", "path=1"),
    *("path.segments.99.length_m=1", "path.segments[-1].length_m=1", "link.0=1", "link=[[1]]"),
    *("links.loss_ratio=nan", "seed=1e400", f"seed={'9' * 5000}", f"seed=0x{'f' * 5000}"),
    *("convoy.names=['\x1b[31m']", "[=]", "links.loss_ratio=" + "[" * 3000, "x." * 3000 + "x=1"),
    *(
        "extends='lane_change'",
        "path.file=1",
        "start_at=2026-01-01",
        "start_at=0001-01-01T00:00:00Z",
    ),
)


@pytest.mark.parametrize("place", range(len(ODD_FILES)))
def test_a_file_of_something_else_is_refused_in_lines(place: int, tmp_path: Path) -> None:
    file = tmp_path / "broken.toml"
    file.write_bytes(ODD_FILES[place])
    with pytest.raises(ScenarioError) as caught:
        load_scenario(file)
    assert all(line and line.isprintable() and len(line) < 1000 for line in caught.value.lines)


@pytest.mark.parametrize("place", range(len(ODD_OVERRIDES)))
def test_an_odd_override_is_refused_in_lines(place: int) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("lane_change", [ODD_OVERRIDES[place]])
    assert all(line and line.isprintable() for line in caught.value.lines)
