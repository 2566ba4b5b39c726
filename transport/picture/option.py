"""The destination of the picture, as text and as options of commands."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from transport.picture.viewer_process import ViewerError

Sink = Literal["off", "spawn", "serve", "connect", "save"]
LOOPBACK = "127.0.0.1"
PAGE_PORT = 9090
DATA_PORT = 9876  # Rerun's usual ports. If they are in use, the default is any free port


@dataclass(frozen=True, slots=True)
class RerunOption:
    """The destination of the picture.

    `target` is the URL of `connect` or the path of `save`. `serve` uses `address` and the ports of
    the web page and of its data (0: the usual port).
    """

    sink: Sink
    target: str = ""
    address: str = LOOPBACK
    page_port: int = 0
    data_port: int = 0


_ADDRESS = r"(?P<address>\d+\.\d+\.\d+\.\d+|localhost)"
_PORTS = r"(?P<page>\d{1,5})(?::(?P<data>\d{1,5}))?"
_SERVE = re.compile(rf"(?:{_ADDRESS}(?:$|:(?=\d)))?(?:{_PORTS})?")
_FORMS = "--spawn, --serve, --serve-at [ADDRESS:]PORT[:DATA_PORT], --connect URL or --save FILE"


def spelled(text: str) -> str:
    """Options that request a destination, such as "--save run.rrd"."""
    sink, equals, value = text.partition("=")
    return f"--{sink}{'-at' * (equals != '' and sink == 'serve')} {value}".rstrip()


def parse_rerun_option(text: str) -> RerunOption:
    """Read a destination; raises ViewerError.

    `serve=0.0.0.0:9090:9876` serves the web page on port 9090 and its data on port 9876 of all
    interfaces, as a container needs it. The default address is 127.0.0.1.
    """
    sink, equals, value = text.partition("=")
    match sink, bool(value):
        case (("off" | "spawn" | "serve"), False) if not equals:
            return RerunOption(sink)
        case "save", True:
            return RerunOption("save", target=value)
        case "connect", True:
            url = urlsplit(value)
            if url.scheme in {"rerun", "rerun+http", "rerun+https"} and url.hostname:
                return RerunOption("connect", target=value)
            raise ViewerError(
                f"{spelled(text)}: {value} is no Rerun URL like "
                f"rerun+http://127.0.0.1:{DATA_PORT}/proxy"
            )
        case "serve", True:
            parts = _SERVE.fullmatch(value)
            ports = [int(parts[name] or 0) for name in ("page", "data")] if parts else [65536]
            if parts and max(ports) < 65536:
                return RerunOption("serve", "", parts["address"] or LOOPBACK, *ports)
    raise ViewerError(f"{spelled(text)}: give {_FORMS}")


def require_cursor(option: RerunOption) -> None:
    """Raise ViewerError if the picture has no time cursor that a program can move."""
    if option.sink not in {"spawn", "connect"}:
        raise ViewerError(
            "--at moves the cursor of a viewer, and files and web pages of Rerun store none; use "
            "--spawn or --connect URL"
        )


def refuse_foreign_file(option: RerunOption) -> None:
    """Raise ViewerError if `save` would overwrite a file that is no recording of Rerun."""
    path = Path(option.target)
    if option.sink == "save" and (path.exists() or path.is_symlink()) and path.suffix != ".rrd":
        raise ViewerError(
            f"{path}: exists and is no recording of Rerun; give another file by --save FILE"
        )
