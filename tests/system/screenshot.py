"""Pictures of Rerun's viewer without a display, for tests and for the README.

    python -m tests.system.screenshot runs/…/run.mcap picture.png --at 22

Needs Vulkan. Without a graphics card, install mesa-vulkan-drivers (a few seconds per picture).
"""

import argparse
import io
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from rerun.experimental import ViewerClient

from scenarios.results.review import review
from transport.picture import viewer_process
from transport.picture.option import parse_rerun_option

START_S = 20.0
SETTLE_S = 1.5
"""A picture that does not change within this time is complete."""
GLANCE_S = 0.2
"""Time between pictures while waiting for something to appear."""
TOP_BAR = 36
"""Height (pixels) of the viewer's menu, which is cropped."""


def can_take_pictures() -> bool:
    """Whether this machine has a Vulkan driver."""
    return any(Path("/usr/share/vulkan/icd.d").glob("*.json"))


@contextmanager
def headless_viewer(source: str, size: str = "1600x1000") -> Iterator[ViewerClient]:
    """Open a viewer without a window on `source`, a recording's path or a server's URL."""
    port = viewer_process.free_port("127.0.0.1", 0)
    flags = ["--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", size]
    viewer = subprocess.Popen(
        [str(viewer_process.viewer_binary()), *flags, source],
        env=viewer_process.quiet_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + START_S
        while not viewer_process.is_listening("127.0.0.1", port):
            assert time.monotonic() < deadline, "the viewer does not start"
            time.sleep(0.1)
        yield ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
    finally:
        viewer_process.stop(viewer)


def picture_now(client: ViewerClient) -> Any:
    """The current picture of the viewer, without its menu."""
    picture = Image.open(io.BytesIO(client.take_screenshot())).convert("RGB")
    return picture.crop((0, TOP_BAR, picture.width, picture.height))


def take_picture(client: ViewerClient, at_s: float, *, settled: bool = True) -> Any:
    """The picture of the viewer at a time of the run (s), without its menu.

    The viewer loads gradually: with `settled`, wait until the picture stops changing.
    """
    deadline = time.monotonic() + START_S
    while True:
        try:
            client.set_time("run_time", duration=at_s, play_state="paused")
            break
        except ConnectionError:  # the recording is still loading
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
    before = None
    while True:
        time.sleep(SETTLE_S if settled else GLANCE_S)
        picture = picture_now(client)
        if not settled or picture == before or time.monotonic() > deadline:
            return picture
        before = picture


def picture_of(log: Path, at_s: float, size: str = "1600x1000") -> Any:
    """Take a picture of a recorded log as `convoy review` shows it."""
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "run.rrd"
        review(log, parse_rerun_option(f"save={recording}"), wait=lambda _: None)
        with headless_viewer(str(recording), size) as client:
            time.sleep(SETTLE_S)  # else the empty window counts as settled
            return take_picture(client, at_s)


def main() -> None:
    parser = argparse.ArgumentParser(description="Take a picture of a recorded run.")
    parser.add_argument("log", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--at", type=float, default=10.0, help="time of the run in seconds")
    parser.add_argument("--size", default="1600x1000")
    given = parser.parse_args()
    picture_of(given.log, given.at, given.size).save(given.picture)


if __name__ == "__main__":
    main()
