import errno
import json
import os
import random
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from socket import socket

import click
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.channel.presets import presets, read_preset
from scenarios.definition.library import template
from scenarios.definition.scenario import drills, library, load_scenario
from scenarios.results.log_summary import log_in
from scenarios.runs.live import LiveRun
from scenarios.runs.run_log import RunLog
from transport.codec import encode
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import RUN_SENDER, TOPIC_OF, key
from vehicles.schedule import SECOND

COMMANDS = sorted(cli.commands)
SHORT = ("lane_change", "--clock", "virtual", "--set", "duration_s=2")

README = Path(__file__).parents[3] / "README.md"


@pytest.fixture(autouse=True)
def own_signals() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def convoy(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)))


def process(*arguments: str | Path, **environment: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "scenarios.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60.0,
        env={"PATH": "/usr/bin:/bin", "COLUMNS": "80", **environment},
        check=False,
    )


def refused(result: Result) -> str:
    assert result.exit_code == 2, (result.output, result.exception)
    assert isinstance(result.exception, SystemExit)
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    return lines[0].removeprefix("error: ")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "finished"
    assert convoy("run", *SHORT, "--out", folder, "--quiet").exit_code == 0
    return folder


# ---- Help


def examples(help_text: str) -> list[str]:
    line = r"^\s*(?:Example:)?\s+convoy (.*?)(?:\s{3,}.*| > .*)?$"
    found = re.findall(line, help_text, re.MULTILINE)
    return [line for line in found if line]


def test_help_lists_every_command_with_examples() -> None:
    result = convoy("--help")
    assert result.exit_code == 0
    for command in COMMANDS:
        assert re.search(rf"^  {command} |`convoy\s+{command}`", result.stdout, re.MULTILINE)
    assert len(examples(result.stdout)) >= 4


@pytest.mark.parametrize("command", COMMANDS)
def test_examples_in_help_parse(command: str) -> None:
    result = convoy(command, "--help")
    assert result.exit_code == 0
    shown = [line for line in examples(result.stdout) if line.split()[0] == command]
    assert shown
    for line in shown:
        arguments = shlex.split(line)[1:]
        with cli.commands[command].make_context(command, arguments):  # raises if it does not
            pass


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_has_a_help_text(command: str) -> None:
    for parameter in cli.commands[command].params:
        if isinstance(parameter, click.Option):
            assert parameter.help, parameter.name


def test_the_version_is_that_of_the_distribution() -> None:
    result = convoy("--version")
    assert result.exit_code == 0
    assert re.search(r"\b\d+\.\d+\.\d+\b", result.stdout)


def test_help_imports_no_slow_packages() -> None:
    code = "import scenarios.cli, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not {"numpy", "scipy", "rerun", "mcap", "rich", "matplotlib"} & set(
        loaded.stdout.split()
    )


# ---- list, new, check


def test_the_fork_server_imports_no_modules_of_the_recorder() -> None:
    code = (
        "import scenarios.cli.run_commands, scenarios.runs.processes.supervisor\n"
        "import scenarios.runs.processes.vehicle_process\n"
        "import sys; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {*done.stdout.split()}
    assert "zenoh" in loaded
    assert not {"rich", "mcap", "zstandard", "foxglove_schemas_protobuf", "scipy", "rerun"} & loaded
    assert "scenarios.runs.live" not in loaded


def test_a_virtual_run_imports_no_bus_and_no_theory() -> None:
    code = "import scenarios.cli.launching, sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    unneeded = {"zenoh", "psutil", "scipy"}
    assert not unneeded & {*done.stdout.split()}


def test_list_names_shipped_scenarios() -> None:
    result = convoy("list")
    assert result.exit_code == 0
    scenarios, channels, failures = (part.splitlines() for part in result.stdout.split("\n\n"))
    assert scenarios[0] == "scenarios, for convoy run:"
    assert [line.split()[0] for line in scenarios[1:]] == list(library())
    for line, name in zip(scenarios[1:], library(), strict=True):
        assert line.endswith(load_scenario(name).tables.description)
    assert channels[0] == "channel presets, for links.preset:"
    assert [line.split()[0] for line in channels[1:]] == list(presets())
    for line, name in zip(channels[1:], presets(), strict=True):
        assert line.endswith(read_preset(name).description)
    assert failures[0] == "drills, for convoy drill:"
    assert [line.split()[0] for line in failures[1:]] == list(drills())
    rows = [scenarios[1], channels[1], failures[-5]]
    starts = {len(line) - len(line.split(None, 1)[1]) for line in rows}
    assert len(starts) == 1  # one column for the descriptions, wide enough for all names
    assert starts == {max(map(len, (*library(), *presets(), *drills()))) + 1}


def test_new_writes_a_scenario_that_can_be_checked_and_run(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    result = convoy("new", file)
    assert result.exit_code == 0
    assert f"convoy run {file}" in result.stdout
    assert file.read_text(encoding="utf-8") == template()
    assert convoy("check", file).exit_code == 0
    ran = convoy(
        "run", file, "--clock", "virtual", "--set", "duration_s=1", "--out", tmp_path / "run"
    )
    assert ran.exit_code == 0


def test_new_does_not_overwrite(tmp_path: Path) -> None:
    file = tmp_path / "my.toml"
    file.write_text("precious", encoding="utf-8")
    assert refused(convoy("new", file)) == f"{file}: file exists"
    assert file.read_text(encoding="utf-8") == "precious"


def test_check_prints_the_settings(tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())
    result = convoy("check", "lane_change", "--set", "convoy.gap_m=7", "--set", "duration_s=30")
    assert result.exit_code == 0
    assert "v1, v2, v3, v4" in result.stdout
    assert "30.0 s" in result.stdout
    assert "7, 7, 7 m" in result.stdout
    assert sorted(tmp_path.iterdir()) == before
    figures = json.loads(convoy("check", "lane_change", "--json").stdout)
    assert figures["name"] == "lane_change"
    assert figures["vehicles"] == ["v1", "v2", "v3", "v4"]
    assert figures["seed"] == 1
    assert figures["channel"]["v1 → v2"]["latency_ms_mean"] == 20.0
    assert "gaps" not in convoy("check", "lane_change", "--set", "convoy.vehicles=1").stdout
    assert figures["speed_mps_max"] == pytest.approx(30.0)


# ---- What cannot be used


WRONG: dict[str, tuple[Sequence[str], str]] = {
    "unknown key": (["lane_change", "--set", "speed.fast=3"], "speed.fast: unknown key"),
    "wrong type": (["lane_change", "--set", "duration_s=soon"], 'duration_s: given "soon"'),
    "negative rate": (["lane_change", "--set", "gnss.rate_hz=-20"], "gnss.rate_hz: given -20"),
    "not a number": (["lane_change", "--set", "speed.set_mps=nan"], "speed.set_mps: given nan"),
    "no value": (["lane_change", "--set", "seed"], "key=value"),
    "no such scenario": (["lane_chagne"], "did you mean lane_change?"),
    "names far apart": (["missing.toml"], "missing.toml: no such file, shipped scenarios are"),
    "no such file": (["nowhere/my.toml"], "nowhere/my.toml: no such file"),
}


@pytest.mark.parametrize("command", ["run", "check", "record"])
@pytest.mark.parametrize("case", WRONG)
def test_a_broken_scenario_is_refused_in_one_line(
    command: str, case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "session.toml").touch()
    arguments, expected = WRONG[case]
    assert expected in refused(convoy(command, *arguments))
    assert [file.name for file in tmp_path.iterdir()] == ["session.toml"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--gains", "0", "1", "1"], "--gains: 0.0 is not in the range"),
        (["--gains", "nan", "1", "1"], "--gains: nan is not a finite number"),
        (["--gains", "0.06", "1", "inf"], "--gains: inf is not in the range"),
        (["--speed", "nan"], "--speed: nan is not a finite number"),
        (["--speed", "1e300"], "--speed: 1e+300 is not in the range"),
    ],
)
def test_gains_and_speeds_out_of_range_are_refused(
    arguments: list[str], line: str, tmp_path: Path
) -> None:
    result = convoy("paper", "gains", *arguments, "--out", tmp_path / "gains")
    assert refused(result).startswith(line)
    assert not (tmp_path / "gains").exists()


def test_a_router_on_a_used_port_names_the_option() -> None:
    with socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        line = refused(convoy("router", "-l", endpoint))
    assert endpoint in line
    assert "address already in use" in line
    assert line.endswith(" -l")


def test_a_controller_in_the_working_folder_is_found(tmp_path: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.DOTALL | re.MULTILINE)
    (own,) = (block for block in blocks if "class PurePursuit" in block)
    assert len(own.splitlines()) <= 12
    (tmp_path / "mine.py").write_text(own, encoding="utf-8")
    code = "import sys; sys.path[0] = '/'; from scenarios.cli.__main__ import main; main()"
    arguments = [*SHORT, "--quiet", "--out", "run", "--set", "control.controller=mine.PurePursuit"]
    ran = subprocess.run(
        [sys.executable, "-c", code, "run", *arguments],
        cwd=tmp_path, capture_output=True, text=True, timeout=60.0, check=False,
    )  # fmt: skip
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


def test_a_vehicle_that_is_not_in_the_scenario_is_refused() -> None:
    line = refused(convoy("vehicle", "lane_change", "--name", "v9"))
    assert '"v9", allowed v1, v2, v3, v4' in line


@pytest.mark.parametrize("option", ["--save=", "--connect=", "--serve-at=box"])
def test_an_unknown_viewer_is_refused_before_anything_is_written(
    option: str, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    line = refused(convoy("run", *SHORT, option, "--out", out))
    assert "--spawn" in line
    assert not out.exists()


@pytest.mark.parametrize("clock", ["wall", "virtual"])
def test_a_viewer_without_a_display_is_refused_before_anything_is_started(
    clock: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    out = tmp_path / "run"
    line = refused(convoy("run", "--clock", clock, "--spawn", "--out", out))
    assert "no display" in line
    assert "serve" in line
    assert "--save FILE" in line
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "missing", "extra"),
    [
        (["run", "--spawn"], ("rerun",), "viewer"),
        (["run", "--clock", "virtual", "--save", "run.rrd"], ("rerun",), "viewer"),
        (["record", "--serve"], ("rerun",), "viewer"),
        (["review", "run.mcap"], ("rerun",), "viewer"),
        (["paper", "gains"], ("scipy",), "studies"),
        (["paper", "reproduce"], ("scipy",), "studies"),
    ],
)
def test_a_missing_extra_is_named_before_the_start(
    arguments: list[str],
    missing: tuple[str, ...],
    extra: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for package in missing:
        monkeypatch.setitem(sys.modules, package, None)  # cannot be imported
    line = refused(convoy(*arguments))
    needed = f"needs {' and '.join(missing)}, not installed here"
    assert line.endswith(f"{needed}: pip install 'convoy-emulator[{extra}]'")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["report", "review"])
@pytest.mark.parametrize(
    ("content", "why"),
    [(None, "no such file"), (b"", "empty"), (b"rubbish" * 100, "not an MCAP log")],
)
def test_an_invalid_log_is_refused_in_one_line(
    command: str, content: bytes | None, why: str, tmp_path: Path
) -> None:
    log = tmp_path / "run.mcap"
    if content is not None:
        log.write_bytes(content)
    assert why in refused(convoy(command, log)).lower().replace("mcap", "MCAP")


def test_a_process_refuses_with_one_line_per_problem(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text('name = "broken"\nduration_s = -3\n[path]\nkind = "loop"\n', encoding="utf-8")
    ended = process("run", broken, "--out", tmp_path / "run")
    assert (ended.returncode, ended.stdout) == (2, "")
    lines = ended.stderr.splitlines()
    assert len(lines) == 2  # a line for each of the two problems
    assert all(line.startswith(f"error: {broken}: ") for line in lines)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("command", ["report", "review"])
def test_a_folder_of_runs_is_refused_with_the_runs_inside(command: str, tmp_path: Path) -> None:
    for name in "abcde":
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.mcap").touch()
    line = refused(convoy(command, tmp_path))
    assert "5 runs" in line
    assert str(tmp_path / "e") in line
    assert str(tmp_path / "a") not in line


@pytest.mark.parametrize(
    ("arguments", "example"),
    [
        (["--clock", "virtual", "run"], "convoy run --clock"),
        (["--junit", "out.xml", "drill"], "convoy drill --junit"),
        (["--seed", "3"], "convoy run --seed"),
    ],
)
def test_an_option_before_the_command_is_refused_with_its_place(
    arguments: list[str], example: str
) -> None:
    line = refused(convoy(*arguments))
    assert line.startswith(f"{arguments[0]}: belongs after the command")
    assert example in line


# ---- run


def test_run_writes_a_log_and_a_summary(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "run"
    result = convoy("run", *SHORT, "--seed", "5", "--out", out)
    assert result.exit_code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "run.mcap",
        "summary.json",
    ]
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (summary["outcome"], summary["seed"], summary["ran_s"]) == ("completed", 5, 2.0)
    assert not LogReader(out / "run.mcap").truncated
    title = "lane_change, seed 5, α 0.5, loss 0 %, duration_s=2, virtual clock, 2.0 s\n"
    assert result.stdout.startswith(title)
    assert result.stdout.endswith(f"log: {out / 'run.mcap'}\n")


def test_a_log_is_never_overwritten(finished: Path) -> None:
    before = (finished / "run.mcap").read_bytes()
    log = finished / "run.mcap"
    line = refused(convoy("run", *SHORT, "--seed", "9", "--out", finished))
    assert line == f"{log}: exists; give another folder by --out"
    assert log.read_bytes() == before


def test_the_default_folder_has_start_scenario_and_overrides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert convoy("run", *SHORT, "--seed", "7", "--quiet").exit_code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert re.fullmatch(r"\d{8}-\d{6}-lane_change-duration_s=2-seed=7", folder.name)


def test_another_process_writes_the_same_bytes(finished: Path, tmp_path: Path) -> None:
    ended = process(
        "run", *SHORT, "--out", tmp_path, "--quiet",
        PYTHONHASHSEED="12345", TZ="Asia/Tokyo", LC_ALL="C", OPENBLAS_NUM_THREADS="2",
    )  # fmt: skip
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
    for name in ("run.mcap", "summary.json"):
        assert (tmp_path / name).read_bytes() == (finished / name).read_bytes()


def test_ctrl_c_ends_a_run_with_a_complete_log(tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = ["lane_change", "--clock", "virtual", "--out", str(out), "--quiet"]
    running = subprocess.Popen(
        [sys.executable, "-m", "scenarios.cli", "run", *arguments, "--set", "gnss.rate_hz=100"],
        stderr=subprocess.PIPE,
        text=True,
    )
    with running:
        deadline = time.monotonic() + 30.0
        while not (out / "run.mcap").exists():
            assert time.monotonic() < deadline
            time.sleep(0.01)
        running.send_signal(signal.SIGINT)
        assert running.wait(30.0) == 130
        assert running.stderr is not None
        assert "Traceback" not in running.stderr.read()
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (summary["outcome"], summary["reason"]) == ("failed", "stopped by SIGINT")
    assert 0.0 <= summary["ran_s"] < 35.0
    assert not LogReader(out / "run.mcap").truncated


# ---- report


def test_report_prints_the_tables_of_the_run(finished: Path) -> None:
    log = finished / "run.mcap"
    result = convoy("report", log)
    assert result.exit_code == 0
    assert (
        "lane_change, seed 1, α 0.5, loss 0 %, duration_s=2, virtual clock, 2.0 s" in result.stdout
    )
    rows = [line.split()[0] for line in result.stdout.splitlines() if line.strip()]
    assert [name for name in rows if re.fullmatch(r"v\d", name)][:4] == ["v1", "v2", "v3", "v4"]
    assert result.stdout.endswith(f"log: {log}\n")


def test_report_as_json_is_the_summary(finished: Path) -> None:
    result = convoy("report", finished / "run.mcap", "--json")
    assert result.exit_code == 0
    assert result.stdout == (finished / "summary.json").read_text(encoding="utf-8")


def test_an_incomplete_log_is_reported(finished: Path, tmp_path: Path) -> None:
    scenario = load_scenario("lane_change", ["duration_s=2"])
    run = RunLog(scenario, tmp_path, clock="wall", run_id="killed", live=LiveRun(scenario))
    run.start(scenario.start_at_ns, scenario.start_at_ns)
    for at, vehicle, message in LogReader(finished / "run.mcap").messages():
        if vehicle != RUN_SENDER and at < scenario.start_at_ns + SECOND:
            run.recorder.accept(key(vehicle, TOPIC_OF[type(message)]), encode(message), at)
    run.flush()
    log = tmp_path / "run.mcap"
    result = convoy("report", log)
    assert result.exit_code == 0
    assert "the log breaks off" in result.stdout
    summary = json.loads(convoy("report", log, "--json").stdout)
    assert (summary["outcome"], summary["clock"]) == ("failed", "wall")
    assert [row["poses"] for row in summary["vehicles"]] == [20] * 4
    run.close(scenario.start_at_ns)


@pytest.mark.campaign(10, 300)
def test_a_cut_log_is_reported_or_refused_in_one_line(
    finished: Path, tmp_path: Path, campaign: int
) -> None:
    whole = (finished / "run.mcap").read_bytes()
    cut = tmp_path / "run.mcap"
    summary = json.loads((finished / "summary.json").read_text(encoding="utf-8"))
    assert summary.pop("log_faults") == ""
    chance = random.Random(12)
    for length in (0, *(chance.randrange(len(whole)) for _ in range(campaign))):
        cut.write_bytes(whole[:length])
        result = convoy("report", cut, "--json")
        if result.exit_code == 0:  # the summary lies near the end and may be whole
            found = json.loads(result.stdout)
            faults = found.pop("log_faults")
            assert result.stderr == f"warning: {faults}\n"
            assert found["reason"] == "the log breaks off" or found == summary
        else:
            assert str(cut) in refused(result)


@pytest.mark.parametrize("command", ["report", "review"])
def test_a_command_accepts_the_folder_of_a_log(
    command: str, finished: Path, tmp_path: Path
) -> None:
    options = [] if command == "report" else ["--save", str(tmp_path / "run.rrd")]
    of_folder = convoy(command, finished, *options)
    assert of_folder.exit_code == 0
    assert of_folder.stdout == convoy(command, finished / "run.mcap", *options).stdout
    line = refused(convoy(command, tmp_path, *options))
    assert line.startswith(f"{tmp_path / 'run.mcap'}: ")


@pytest.mark.parametrize("command", ["review", "run", "record"])
def test_a_recording_does_not_overwrite_another_file(
    command: str, finished: Path, tmp_path: Path
) -> None:
    precious = tmp_path / "my.toml"
    precious.write_text("precious", encoding="utf-8")
    what = finished / "run.mcap" if command == "review" else "lane_change"
    options: list[str | Path] = [] if command == "review" else ["--out", tmp_path / "run"]
    line = refused(convoy(command, what, "--save", precious, *options))
    assert line.startswith(f"{precious}: exists and is no recording")
    assert precious.read_text(encoding="utf-8") == "precious"
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", ["gains.json", "propagation.png"])
def test_gains_does_not_overwrite_other_files(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text('{"precious": true}', encoding="utf-8")
    line = refused(convoy("paper", "gains", "--speed", "20", "--out", tmp_path))
    assert line.startswith(f"{tmp_path / name}: exists")
    assert (tmp_path / name).read_text(encoding="utf-8") == '{"precious": true}'


@pytest.mark.parametrize(
    "name", ["report.md", "report.json", "fitted/base/run.mcap", "radius_fitted.png"]
)
def test_reproduce_does_not_overwrite_anything(name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("precious", encoding="utf-8")
    line = refused(convoy("paper", "reproduce", "--case", "base", "--out", tmp_path))
    taken = file.parent if "/" in name else file  # the folder of a log, or a file
    assert line.startswith(f"{taken}: exists")
    assert file.read_text(encoding="utf-8") == "precious"


FULL = """
import resource, sys
from scenarios.cli.main import cli

resource.setrlimit(resource.RLIMIT_FSIZE, (1_200_000, -1))
cli(sys.argv[1:])
"""


def test_a_run_on_a_full_disk_fails_with_a_line_and_a_log(tmp_path: Path) -> None:
    out = tmp_path / "run"
    ended = subprocess.run(
        [sys.executable, "-c", FULL, "run", "lane_change", "--clock=virtual", f"--out={out}",
         "--quiet"],
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    line = f"{out / 'run.mcap'}: cannot write the log: File too large"
    assert (ended.returncode, ended.stdout, ended.stderr) == (1, "", f"error: {line}\n")
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (summary["outcome"], summary["reason"]) == ("failed", line)
    log = LogReader(out / "run.mcap")
    assert log.truncated
    assert not log.damage
    assert log.counts["v1", "truth"] > 100


@pytest.mark.parametrize("number", [errno.EACCES, errno.ENOSPC, errno.EROFS])
@pytest.mark.parametrize("clock", ["wall", "virtual"])
def test_an_unwritable_place_is_a_failed_run(
    number: int, clock: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(**_: object) -> object:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("scenarios.runs.run_folder.TemporaryFile", full)
    ended = convoy("run", *SHORT, "--clock", clock, "--out", tmp_path / "run")
    assert ended.exit_code == 1
    assert ended.stderr == f"error: {tmp_path / 'run'}: {os.strerror(number).lower()}\n"
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "text",
    ["a = " + "[" * 5000 + "]" * 5000, ".".join("a" * 3000) + " = 1", "a = [[[" * 40 + "]]]" * 40],
    ids=["list", "table", "broken"],
)
def test_deeply_nested_toml_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "deep.toml"
    file.write_text(text, encoding="utf-8")
    assert refused(convoy("check", file)).startswith(f"{file}: not valid TOML: ")
    assert "--set" in refused(convoy("check", "--set", text.replace(" ", "")))


def test_an_endless_file_is_refused_at_once() -> None:
    assert refused(convoy("check", "/dev/zero")) == "/dev/zero: not a file"
    assert refused(convoy("report", "/dev/zero")).startswith("/dev/zero: ")


def test_a_misspelt_run_is_answered_with_the_similar_one(tmp_path: Path) -> None:
    (tmp_path / "first").mkdir()
    with pytest.raises(LogError, match=r"frist: .*first\?"):
        log_in(tmp_path / "frist")


def test_a_file_that_is_no_log_is_refused_with_the_expected_one() -> None:
    assert "run.mcap" in refused(convoy("report", README))


def test_an_unknown_option_is_a_usage_error() -> None:
    line = refused(convoy("run", "--fast"))
    assert line.startswith("--fast: ")
    assert "convoy run --help" in line


def test_a_quiet_run_prints_nothing(tmp_path: Path) -> None:
    result = convoy("run", *SHORT, "--quiet", "--out", tmp_path / "run")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")


@pytest.mark.campaign(10, 500)
def test_a_log_with_flipped_bits_is_reported_or_refused_in_one_line(
    finished: Path, tmp_path: Path, campaign: int
) -> None:
    whole = (finished / "run.mcap").read_bytes()
    log = tmp_path / "run.mcap"
    chance = random.Random(11)
    for _ in range(campaign):
        content = bytearray(whole)
        for _ in range(chance.randrange(1, 4)):
            content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        log.write_bytes(content)
        result = convoy("report", log, "--json")
        if result.exit_code == 0:
            json.loads(result.stdout)
        else:
            assert str(log) in refused(result)


def with_a_bit_flipped(log: Path, folder: Path, chunk: int = 1) -> Path:
    """Copy a log with one flipped bit in the messages of a chunk."""
    content = bytearray(log.read_bytes())
    at = -1
    for _ in range(chunk):
        at = content.index(b"\x04\0\0\0zstd", at + 1)
    content[at + 1000] ^= 4
    damaged = folder / "damaged.mcap"
    damaged.write_bytes(content)
    return damaged


def test_a_damaged_log_is_reviewed_with_a_warning(finished: Path, tmp_path: Path) -> None:
    whole = finished / "run.mcap"
    log = with_a_bit_flipped(whole, tmp_path)
    result = convoy("review", log, "--save", tmp_path / "run.rrd")
    assert (result.exit_code, result.stderr.count("\n")) == (0, 1)
    assert result.stderr.startswith(f"{log}: damaged, ")


def test_a_review_does_not_overwrite_its_log(finished: Path) -> None:
    log = finished / "run.mcap"
    before = log.read_bytes()
    assert "no recording" in refused(convoy("review", log, "--save", log))
    assert log.read_bytes() == before


def test_an_impossible_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "run"
    assert refused(convoy("run", *SHORT, "--out", out)).startswith(str(tmp_path / "file"))


def test_destinations_have_the_names_of_rerun(tmp_path: Path) -> None:
    line = refused(convoy("review", tmp_path, "--save", tmp_path / "a.rrd", "--serve"))
    assert "--serve and --save: give one of them" in line
    line = refused(convoy("run", *SHORT, "--connect", "box", "--out", tmp_path / "run"))
    assert line.startswith("--connect box: box is no Rerun URL")
    line = refused(convoy("run", *SHORT, "--serve-at", "99999", "--out", tmp_path / "run"))
    assert line.startswith("--serve-at 99999: give ")
    assert not (tmp_path / "run").exists()
    helped = {
        name: convoy(name, "--help").stdout for name in ("run", "record", "review", "compare")
    }
    for text in helped.values():
        assert all(f"  --{name}" in text for name in ("spawn", "serve", "serve-at", "save"))
    assert "-e, --connect ENDPOINT" in helped["record"]  # Zenoh's
