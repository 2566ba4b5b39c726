"""The picture of a run in Rerun, at the destination that the user requests.

Import this module only for a picture: Rerun takes 90 MB and half a second.
"""

import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import rerun as rr
from rerun.experimental import ViewerClient

from transport.closing import Closing
from transport.picture import viewer_process
from transport.picture.batch import Batch, RunScene
from transport.picture.option import (
    DATA_PORT,
    LOOPBACK,
    PAGE_PORT,
    RerunOption,
    refuse_foreign_file,
)
from transport.picture.run_picture import RunPicture
from transport.picture.viewer_process import ViewerError

APPLICATION = "convoy"
FLUSH_S = 5.0
LOG_FLUSH_S = 120.0  # Longest wait for a viewer to take the picture of a live run, and of a log
CURSOR_S, CURSOR_EVERY_S = 60.0, 0.2  # Longest wait for the viewer's cursor, and between attempts
FLUSH_TICK_S = 0.1


class RerunView(Closing):
    """Shows a run, live or from its log: `draw` takes its messages batch by batch.

    `title` is the name of the recording, `option` is not "off". `destination` describes to the user
    where it is shown. Raises ViewerError if the picture cannot be shown.
    """

    def __init__(
        self, option: RerunOption, *, recording_id: str, scene: RunScene, title: str = ""
    ) -> None:
        self._is_saved = option.sink == "save"
        self._server: subprocess.Popen[bytes] | None = None
        self._viewer = ""
        self._is_open = True
        self.recording = rr.RecordingStream(
            APPLICATION,
            recording_id=recording_id,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=FLUSH_TICK_S),
        )
        self.destination = self._open(option)
        if title:
            self.recording.send_recording_name(title)
        self._picture: RunPicture | None = RunPicture(self.recording, scene)

    def _open(self, option: RerunOption) -> str:
        """Send the recording to its destination, and return that."""
        match option.sink:
            case "save":
                refuse_foreign_file(option)
                self.recording.set_sinks(_save(option.target))
                return option.target
            case "connect":
                self._viewer = option.target
                self.recording.set_sinks(_connect(option.target))
                return option.target
            case "spawn":
                port = viewer_process.free_port(LOOPBACK, DATA_PORT)
                viewer_process.start_native_viewer(port)
                self._viewer = f"rerun+http://{LOOPBACK}:{port}/proxy"
                self.recording.set_sinks(rr.GrpcSink(self._viewer))
                return "Rerun's viewer"
            case _:
                return self._serve(option)

    def _serve(self, option: RerunOption) -> str:
        address = option.address
        data_port = viewer_process.free_port(address, DATA_PORT, option.data_port)
        page_port = viewer_process.free_port(address, PAGE_PORT, option.page_port)
        self._server = viewer_process.start_server(address, page_port, data_port)
        host = viewer_process.local_address(address)
        data_url = f"rerun+http://{host}:{data_port}/proxy"
        self.recording.set_sinks(rr.GrpcSink(data_url))
        return f"http://{host}:{page_port}/?url={quote(data_url, safe='')}"

    def draw(self, batch: Batch) -> None:
        if self._picture is not None:
            self._picture.draw(batch)

    def finish(self) -> None:
        """Draw what is still open and fit the layout to the run; nothing is drawn after it."""
        picture, self._picture = self._picture, None
        if picture is not None:
            with suppress(RuntimeError):  # the run continues without a viewer
                picture.finish()

    def show_at(self, at_s: float) -> None:
        """Move the time cursor of the viewer to a time (s) after the start of the run.

        Raises ViewerError if the viewer does not do it.
        """
        self.recording.flush(timeout_sec=LOG_FLUSH_S)
        deadline = time.monotonic() + CURSOR_S
        while True:
            try:
                client = ViewerClient.connect(self._viewer)
                client.set_time("run_time", duration=at_s, play_state="paused")
            except (ConnectionError, RuntimeError) as error:  # the recording is still loading
                if time.monotonic() > deadline:
                    raise ViewerError(f"the viewer does not move to {at_s:g} s: {error}") from error
                time.sleep(CURSOR_EVERY_S)
            else:
                return

    def close(self) -> None:
        """Finish the picture, send all data and end the programs started for it.

        Raises UnwritableRecordingError if the file of a saved recording is incomplete.
        """
        self.finish()
        failure = ""
        if self._is_open:
            self._is_open = False
            try:
                self.recording.flush(timeout_sec=FLUSH_S)
            except RuntimeError as error:  # a viewer that was closed is no failure
                failure = str(error) if self._is_saved else ""
            self.recording.disconnect()
        if self._server is not None:
            viewer_process.stop(self._server)
            self._server = None
        if failure:
            raise viewer_process.UnwritableRecordingError(
                f"{self.destination}: cannot write the recording: {failure.lower()}"
            )


def _save(path: str) -> Any:
    try:
        with Path(path).open("wb"):  # Rerun would only warn
            return rr.FileSink(path)
    except OSError as error:
        raise ViewerError(f"{path}: cannot write the recording: {error.strerror}") from error


def _connect(url: str) -> Any:
    parts = urlsplit(url)
    if not viewer_process.is_listening(parts.hostname or "", parts.port or DATA_PORT):
        raise ViewerError(f"{url}: no Rerun viewer listens there")
    return rr.GrpcSink(url)
