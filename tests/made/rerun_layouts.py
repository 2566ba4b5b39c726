"""Rerun's layouts next to logs: the process that writes one takes 0.9 s of processor time."""

import subprocess
from contextlib import AbstractContextManager
from typing import Any
from unittest.mock import patch

from scenarios.results.pictures import layouts
from transport.picture import viewer_process


def without_layouts() -> AbstractContextManager[Any]:
    """Runs within the context start a process that writes nothing."""
    return patch.object(layouts, "start_log_layout", lambda *_, **__: subprocess.Popen(["true"]))


def with_layouts() -> AbstractContextManager[Any]:
    """Runs within the context write their layouts, also inside `without_layouts`."""
    return patch.object(layouts, "start_log_layout", viewer_process.start_log_layout)
