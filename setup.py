"""List the packages, and compile the modules that use most processor time on request.

The request is `CONVOY_COMPILE=1` in the environment.

Compiled modules give the same bits (`tests/system/test_compiled.py`); for that they sum lists, not
generators, which mypyc would add up as Python did up to 3.11. Not compiled are protocols checked at
run time, and classes whose annotations are read: messages and the contents of the summary. Nothing
interpreted can inherit from a compiled class, or read its docstring, as `convoy reference` does.

mypyc inlines constants annotated as Final. It cannot compile a keyword-only argument whose default
is a number.
"""

import os
import sys
from pathlib import Path

from setuptools import Extension, find_packages, setup

LAYOUT = {
    "packages": [*find_packages(include=["vehicles*", "transport*", "scenarios*"]), "convoy"],
    "package_dir": {"convoy": "scenarios/api"},
}
"""Installed packages: `convoy`, the Python interface, is the folder scenarios/api."""
NEEDS = ["mypy[mypyc]==2.4.1", "numpy>=2.0"]
"""The compiler whose bits were compared, and the types of arrays."""
MODULES = {
    "vehicles": "received_pose schedule",
    "vehicles/geometry": "arc_fits arc_spline driven_path geodesy sampled_path",
    "vehicles/preview": "curve_fit joined_fit samples trace trajectory",
    "vehicles/car": "dynamics gnss imu noise outline path_history path_keeping tyres",
    "vehicles/driver": "command_limit decision follower innovation_gate intended_path leader"
    " modes own_state pose_estimator situation source sources"
    " speed speed_guard watch",
    "transport": "clock codec",
    "transport/bus": "telemetry",
    "transport/links": "content_stage inbox link",
    "transport/log": "writer",
    "scenarios/results": "accumulators encounters link_figures link_tally metrics stream watches",
    "scenarios/runs": "recorder",
    "scenarios/runs/node": "node outbox phases process_probe sink",
    "scenarios/runs/processes": "arrivals vehicle_process",
}
"""Names of the compiled modules by folder."""


def compiled() -> list[str]:
    """Paths of the modules to compile; raises FileNotFoundError for a missing one."""
    paths = [f"{folder}/{name}.py" for folder, names in MODULES.items() for name in names.split()]
    missing = [path for path in paths if not Path(path).exists()]
    if missing:
        raise FileNotFoundError(f"MODULES in setup.py lists {', '.join(missing)}: no such module")
    return paths


def extensions() -> list[Extension]:
    """Extension modules to build; none where only metadata is requested."""
    if not {"build_ext", "bdist_wheel", "editable_wheel"} & set(sys.argv):
        return []
    from mypyc.build import mypycify  # noqa: PLC0415 - needed only where modules are compiled

    options = ["--config-file=", "--ignore-missing-imports", "--follow-imports=silent"]
    found: list[Extension] = mypycify(
        [*options, *compiled()],
        opt_level="1",  # runs as fast as with higher levels, and builds in half the time
        debug_level="0",
        multi_file=True,
        group_name="convoy",
    )
    for extension in found:  # no fused multiply-add, and pow and sin of the C library only
        extension.extra_compile_args += ["-ffp-contract=off", "-fno-builtin"]
    return found


if os.environ.get("CONVOY_COMPILE", "0") not in {"", "0"}:
    setup(**LAYOUT, setup_requires=NEEDS, ext_modules=extensions())
else:
    setup(**LAYOUT)
