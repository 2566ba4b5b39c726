"""A headless browser, controlled over its debugging pipe (Chrome DevTools protocol)."""

import base64
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from PIL import Image

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--remote-debugging-pipe",
    # The page requests fonts and other files; no test connects to other machines.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--window-size=800,560",  # small, as it is drawn without a graphics card
)
WITH_PIPES = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 100) for end in sys.argv[1:3]]
for end, wanted in zip(ends, (3, 4)):
    os.dup2(end, wanted)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""Chromium reads commands from file descriptor 3, and writes responses to 4."""


class BrowserError(Exception):
    """A command that the browser refuses."""


class Browser:
    """One tab of a browser."""

    def __init__(self, commands: int, responses: int) -> None:
        self._commands, self._responses = commands, responses
        self._buffer = b""
        self._number = 0
        self._session = ""
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]

    def open(self, url: str) -> None:
        """Open a page, without waiting until it is loaded."""
        self._call("Page.navigate", url=url)

    def picture(self) -> Any:
        """The current picture of the page; retried while a page is being replaced."""
        for _ in range(50):
            with suppress(BrowserError):
                data = self._call("Page.captureScreenshot", format="png")["data"]
                break
            time.sleep(0.1)
        return Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        command = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        os.write(self._commands, json.dumps(command).encode() + b"\0")
        while True:
            response = self._read()
            if response.get("id") == self._number:
                if "error" in response:
                    raise BrowserError(response["error"])
                result: dict[str, Any] = response["result"]
                return result

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            more = os.read(self._responses, 1 << 20)
            assert more, "the browser has ended"
            self._buffer += more
        message, _, self._buffer = self._buffer.partition(b"\0")
        content: dict[str, Any] = json.loads(message)
        return content


@contextmanager
def browser() -> Iterator[Browser]:
    """Start a browser with a new profile; it ends with the context."""
    assert CHROMIUM
    (their_commands, commands), (responses, their_responses) = os.pipe(), os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        ends = (str(their_commands), str(their_responses))
        process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                WITH_PIPES,
                *ends,
                CHROMIUM,
                *FLAGS,
                f"--user-data-dir={profile}",
            ],
            pass_fds=(their_commands, their_responses),
            env={**os.environ, "HOME": profile},
            cwd=Path(profile),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(their_commands)
        os.close(their_responses)
        try:
            yield Browser(commands, responses)
        finally:
            os.close(commands)  # ends the browser
            with suppress(subprocess.TimeoutExpired):
                process.wait(3.0)
            process.kill()
            process.wait()
            os.close(responses)
