"""The picture of a run in Rerun: where it goes, and what is drawn.

Rerun itself (90 MB, half a second) is loaded only when a picture is wanted.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self
from urllib.parse import quote, urlsplit

from transport.picture import viewer_process
from transport.picture.viewer_process import ViewerError
from vehicles.messages import Message

__all__ = ["RerunOption", "RerunView", "ViewerError", "parse_rerun_option"]

Sink = Literal["off", "spawn", "serve", "connect", "save"]
APPLICATION = "convoy"
LOOPBACK = "127.0.0.1"
PAGE_PORT = 9090
DATA_PORT = 9876
"""Rerun's usual ports; if they are taken and nobody asked for them, any free one is used."""
MEMORY_LIMIT = "512MB"
"""What a server keeps for viewers that come later; beyond it the oldest data go first."""
FLUSH_S = 5.0
FLUSH_TICK_S = 0.1
CAR_M = (4.93, 1.86)
"""Length and width of a Lincoln MKZ."""


@dataclass(frozen=True, slots=True)
class RerunOption:
    """Where the picture goes.

    `target` is the URL of `connect` or the path of `save`. `address` and the two ports (0: the
    usual one) are those of `serve`: the web page, and the data it shows.
    """

    sink: Sink
    target: str = ""
    address: str = LOOPBACK
    page_port: int = 0
    data_port: int = 0


_ADDRESS = r"(?P<address>\d+\.\d+\.\d+\.\d+|localhost)"
_PORTS = r"(?P<page>\d{1,5})(?::(?P<data>\d{1,5}))?"
_SERVE = re.compile(rf"(?:{_ADDRESS}(?:$|:(?=\d)))?(?:{_PORTS})?")
_FORMS = "off, spawn, serve, serve=[ADDRESS:]PORT[:DATA_PORT], connect=URL or save=PATH"


def parse_rerun_option(text: str) -> RerunOption:
    """Read the value of `--rerun`; raises ViewerError with one clear line.

    `serve=0.0.0.0:9090:9876` serves the web page on port 9090 and its data on port 9876 of all
    interfaces, as a container needs it; without an address both stay on 127.0.0.1.
    """
    sink, given, value = text.partition("=")
    match sink, bool(value):
        case (("off" | "spawn" | "serve"), False) if not given:
            return RerunOption(sink)
        case "save", True:
            return RerunOption("save", target=value)
        case "connect", True:
            url = urlsplit(value)
            if url.scheme in {"rerun", "rerun+http", "rerun+https"} and url.hostname:
                return RerunOption("connect", target=value)
            raise ViewerError(
                f"--rerun {text}: {value} is no Rerun URL like "
                f"rerun+http://127.0.0.1:{DATA_PORT}/proxy"
            )
        case "serve", True:
            found = _SERVE.fullmatch(value)
            ports = [int(found[name] or 0) for name in ("page", "data")] if found else [65536]
            if found and max(ports) < 65536:
                return RerunOption("serve", "", found["address"] or LOOPBACK, *ports)
    raise ViewerError(f"--rerun {text}: give {_FORMS}")


class RerunView:
    """Shows a run, live or from its log: `draw` takes every message as it was recorded.

    `vehicles` are in order, the lead first; `gap_m` is their usual distance; `path` is the
    lead's, as east and north in metres; `road_yaw` (rad) is the direction of the road on which the
    convoy starts. Raises ViewerError if the picture cannot be shown.
    `where` tells a person where to look.
    """

    def __init__(
        self,
        option: RerunOption,
        *,
        run_id: str,
        vehicles: Sequence[str],
        gap_m: float = 15.0,
        car_m: tuple[float, float] = CAR_M,
        path: tuple[Sequence[float], Sequence[float]] | None = None,
        road_yaw: float | None = None,
    ) -> None:
        self.where = ""
        self._page: Any = None
        self._recording: Any = None
        self._picture: Any = None
        if option.sink == "off":
            return
        import rerun as rr  # noqa: PLC0415 - see above

        from transport.picture.picture import Picture  # noqa: PLC0415

        self._recording = rr.RecordingStream(
            APPLICATION,
            recording_id=run_id,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=FLUSH_TICK_S),
        )
        self._recording.set_sinks(self._open(rr, option))
        self._picture = Picture(
            self._recording, vehicles, gap_m=gap_m, car_m=car_m, path=path, road_yaw=road_yaw
        )

    def draw(self, now: int, message: Message) -> None:
        """Draw a message that was recorded at instant `now` (ns)."""
        if self._picture is not None:
            self._picture.draw(now, message)

    def _open(self, rr: Any, option: RerunOption) -> Any:
        match option.sink:
            case "save":
                self.where = option.target
                return _save(rr, option.target)
            case "connect":
                self.where = option.target
                return _connect(rr, option.target)
            case "spawn":
                port = viewer_process.free_port(LOOPBACK, DATA_PORT)
                viewer_process.start_native_viewer(port)
                self.where = "Rerun's viewer"
                return rr.GrpcSink(f"rerun+http://{LOOPBACK}:{port}/proxy")
            case _:
                return self._serve(rr, option)

    def _serve(self, rr: Any, option: RerunOption) -> Any:
        ports = []
        for asked, usual in ((option.page_port, PAGE_PORT), (option.data_port, DATA_PORT)):
            if asked:
                ports.append(viewer_process.take_port(option.address, asked))
            else:
                ports.append(viewer_process.free_port(option.address, usual))
        page_port, data_port = ports
        sink = rr.GrpcServerSink(
            bind_ip=option.address, port=data_port, server_memory_limit=MEMORY_LIMIT
        )
        host = viewer_process.reachable(option.address)
        data_url = f"rerun+http://{host}:{data_port}/proxy"
        self._page = viewer_process.start_web_page(
            address=option.address, port=page_port, data_url=data_url
        )
        self.where = f"http://{host}:{page_port}/?url={quote(data_url, safe='')}"
        return sink

    def close(self) -> None:
        """Hand over everything drawn so far and end what was started for the picture."""
        if self._recording is not None:
            recording, self._recording = self._recording, None
            picture, self._picture = self._picture, None
            with suppress(RuntimeError):  # a viewer that went away is no loss to the run
                picture.finish()
                recording.flush(timeout_sec=FLUSH_S)
            recording.disconnect()
        if self._page is not None:
            viewer_process.stop(self._page)
            self._page = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _save(rr: Any, path: str) -> Any:
    try:
        with Path(path).open("wb"):  # Rerun would only warn
            return rr.FileSink(path)
    except OSError as error:
        raise ViewerError(f"{path}: cannot write the recording: {error.strerror}") from error


def _connect(rr: Any, url: str) -> Any:
    parts = urlsplit(url)
    if not viewer_process.is_heard(parts.hostname or "", parts.port or DATA_PORT):
        raise ViewerError(f"{url}: no Rerun viewer listens there")
    return rr.GrpcSink(url)
