"""A catalog of recordings, served on this machine by Rerun; needs the extra `catalog`."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import rerun as rr
from rerun.error_utils import RerunIncompatibleDependencyVersionError
from rerun.server import Server

from transport.picture import viewer_process
from transport.picture.blueprint import RunExtent, blueprint
from transport.picture.option import LOOPBACK, PAGE_PORT, RerunOption
from transport.picture.view import APPLICATION
from transport.picture.viewer_process import ViewerError

PROPERTIES = "properties"
"""Layer of the figures of a recording; the catalog shows them as columns."""


class CatalogLayout(NamedTuple):
    """What the layout of all recordings depends on, see `RerunView`."""

    vehicles: Sequence[str]
    spacing_m: float
    path: tuple[Sequence[float], Sequence[float]]
    duration_s: float


class CatalogEntry(NamedTuple):
    """A recording of Rerun, its name, and the figures by which the catalog lists it."""

    recording: Path
    recording_id: str
    figures: Mapping[str, Any]


@contextmanager
def serve_catalog(
    name: str, entries: Sequence[CatalogEntry], layout: CatalogLayout | None
) -> Iterator[str]:
    """Serve the recordings as the dataset `name`, with one layout; yields its address.

    Files of figures and layout are written next to the recordings.
    """
    os.environ.setdefault("CI", "1")  # sends no usage statistics
    recordings = [entry.recording for entry in entries]
    server = Server(host=LOOPBACK, datasets={name: recordings})
    try:
        dataset = _client(server).get_dataset(name)
        for entry in entries:
            figures = entry.recording.with_suffix(".figures.rrd")
            _write_figures(figures, entry)
            dataset.register([figures.absolute().as_uri()], layer_name=PROPERTIES).wait()
        if layout is not None:
            file = recordings[0].with_name("layout.rbl").absolute()
            _layout(layout).save(APPLICATION, file)
            dataset.register_blueprint(file.as_uri())
        yield f"{server.url()}/entry/{dataset.id}"
    finally:
        server.shutdown()


@contextmanager
def shown(url: str, option: RerunOption) -> Iterator[str]:
    """Show a catalog in a viewer or on a web page; yields a line that states where.

    Raises ViewerError.
    """
    if option.sink == "spawn":
        viewer_process.open_native_viewer(url)
        yield "Rerun's viewer"
        return
    address, pages = option.address, []

    def serve_page(port: int) -> bool:
        page = viewer_process.start_web_page(address=address, port=port, data_url=url)
        pages.append(page)
        return page is not None

    port = viewer_process.listen(address, option.page_port, PAGE_PORT, serve_page)
    try:
        host = viewer_process.local_address(address)
        yield f"http://{host}:{port}/?url={quote(url, safe='')}"
    finally:
        for page in filter(None, pages):
            viewer_process.stop(page)


def _client(server: Server) -> Any:
    """Client of a server; raises ViewerError with another version of DataFusion than Rerun's."""
    try:
        return server.client()
    except RerunIncompatibleDependencyVersionError as error:
        raise ViewerError(f"browse --catalog: {error}") from error


def _write_figures(path: Path, entry: CatalogEntry) -> None:
    with rr.RecordingStream(APPLICATION, recording_id=entry.recording_id) as recording:
        recording.save(path)
        recording.send_property("run", rr.AnyValues(**entry.figures))
        recording.flush()
        recording.disconnect()


def _layout(layout: CatalogLayout) -> Any:
    extent = RunExtent(layout.duration_s)
    return blueprint(layout.vehicles, spacing_m=layout.spacing_m, road=layout.path, extent=extent)
