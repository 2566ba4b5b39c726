"""Compiles what a run spends its time in, if `CONVOY_COMPILE=1` asks for it; else does nothing.

Compiled modules give the same bits (`tests/system/test_compiled.py`). For that they sum lists and
have no endless generator expressions (`tests/test_project.py`): mypyc makes lists of most of these,
and takes the sum of one plainly, as Python itself does only up to 3.11. What cannot be compiled are
protocols that are asked for at run time, and classes whose annotations are read: messages, by the
codec, and what the summary holds. Compiled classes have no docstrings, cannot be copied, and nobody
else can inherit from them; so what `convoy reference` tells of, and what a controller of one's own
may build upon, is left as it is.
"""

import os
import sys
from pathlib import Path

from setuptools import Extension, setup

NEEDS = ["mypy[mypyc]==2.4.1", "numpy>=2.0"]
"""Whose bits were compared, and whose types say what is compiled."""
ROOMS = {
    "vehicles/geometry": {"bridges", "lanes", "local_regression", "smoothing"},
    "vehicles/preview": {"paper_recipe"},
    "vehicles/car": {"clock_error", "drift", "fix_states", "gnss_errors", "parameters", "sending"},
    "vehicles/driver": {"baselines", "slip_estimator", "steering", "tracking"},
}
"""Rooms of which all modules are compiled but these: they cannot be, or take no time in a run."""
MODULES = (
    *("transport/codec", "scenarios/runs/recorder"),
    *(
        f"transport/links/{name}"
        for name in ("arrival", "gate", "inbox", "line", "link", "remembered")
    ),
    *(f"scenarios/runs/node/{name}" for name in ("node", "outbox", "phases")),
    *(
        f"scenarios/results/{name}"
        for name in ("bodies", "deviations", "encounters", "figures", "metrics")
    ),
    "scenarios/results/channel/tally",
)
"""Modules of other rooms that are compiled."""


def compiled() -> list[str]:
    """Paths of the modules to compile."""
    of_rooms = (
        str(path)
        for room, left_out in ROOMS.items()
        for path in sorted(Path(room).rglob("*.py"))
        if path.stem not in {"__init__", *left_out}
    )
    return [*of_rooms, *(f"{module}.py" for module in MODULES)]


def extensions() -> list[Extension]:
    """What to build; nothing where only names and requirements are asked for."""
    if not {"build_ext", "bdist_wheel", "editable_wheel"} & set(sys.argv):
        return []
    from mypyc.build import mypycify  # noqa: PLC0415 - is here only if it is asked for

    settings = ["--config-file=", "--ignore-missing-imports", "--follow-imports=silent"]
    found: list[Extension] = mypycify(
        [*settings, *compiled()],
        opt_level="1",  # as fast as higher ones, and made in half the time
        debug_level="0",
        multi_file=True,
        group_name="convoy",
    )
    for one in found:  # no a * b + c in one rounding, no pow or sin but the C library's
        one.extra_compile_args += ["-ffp-contract=off", "-fno-builtin"]
    return found


if os.environ.get("CONVOY_COMPILE", "0") not in {"", "0"}:
    setup(setup_requires=NEEDS, ext_modules=extensions())
else:
    setup()
