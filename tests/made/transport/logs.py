"""A log of a synthetic drive, read by other libraries."""

import os
import subprocess
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from tests.made.transport import drive
from transport.codec import encode
from transport.log.foxglove import NO_SCENE, Scene
from transport.log.writer import LogWriter
from transport.picture import viewer_process
from vehicles.messages import Message

TICKS = 60


def write(path: Path, ticks: int = TICKS, scene: Scene = NO_SCENE) -> list[tuple[int, Message]]:
    messages = list(drive.drive(ticks))
    with LogWriter(path, library="test", scene=scene) as log:
        log.metadata("convoy", {"scenario": "circle", "seed": "1"})
        log.attach("scenario.toml", "application/toml", b"seed = 1\n")
        for at, message in messages:
            put(log, at, message)
    return messages


def put(log: LogWriter, at: int, message: Message) -> None:
    log.write(at, message, encode(message))


def rows(path: Path) -> list[Any]:
    with path.open("rb") as file:
        return list(make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))


def rerun_accepts(path: Path) -> bool:
    check = [str(viewer_process.viewer_binary()), "mcap", "check", str(path)]
    done = subprocess.run(check, env={**os.environ, "CI": "1"}, capture_output=True, check=False)
    return done.returncode == 0
