"""Compiles what a run spends its time in, if `CONVOY_COMPILE=1` asks for it; else does nothing.

Compiled modules give the same bits (`tests/system/test_compiled.py`). For that they sum lists and
have no endless generator expressions (`tests/test_project.py`): mypyc makes lists of most of these,
and takes the sum of one plainly, as Python itself does only up to 3.11. What cannot be compiled are
protocols that are asked for at run time, and classes whose annotations are read: messages, by the
codec, and what the summary holds. Compiled classes have no docstrings, cannot be copied, and nobody
else can inherit from them; so what `convoy reference` tells of, and what a controller of one's own
may build upon, is left as it is.

What `dataclass` makes when a module is imported stays interpreted, and the constants of a module
are looked up by name. So what is compiled is a copy of the sources in which these initialisers are
written out, since they are called thousands of times a second, and constants said to be such.
"""

import ast
import os
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

from setuptools import Extension, setup

NEEDS = ["mypy[mypyc]==2.4.1", "numpy>=2.0"]
"""Whose bits were compared, and whose types say what is compiled."""
ROOMS = {
    "vehicles/geometry": {"bridges", "lanes", "local_regression", "smoothing"},
    "vehicles/preview": {"paper_recipe"},
    "vehicles/car": {"drift", "fix_states", "gnss_errors", "parameters"},
    "vehicles/driver": {"baselines", "settings", "slip_estimator", "steering", "tracking"},
}
"""Rooms of which all modules are compiled but these: they cannot be, or take no time in a run."""
MODULES = (
    *("vehicles/schedule", "scenarios/runs/recorder", "scenarios/runs/processes/vehicle"),
    *(
        f"transport/{name}"
        for name in ("clock", "codec", "message_numbers", "telemetry", "thinning")
    ),
    "transport/log/writer",
    *("scenarios/runs/watchers", "scenarios/runs/processes/arrivals"),
    *(
        f"transport/links/{name}"
        for name in ("arrival", "gate", "inbox", "line", "link", "remembered")
    ),
    *(
        f"scenarios/runs/node/{name}"
        for name in (
            *("agenda", "changes", "fault", "node", "outbox", "phases", "probe", "process_probe"),
            "sink",
        )
    ),
    *(
        f"scenarios/results/{name}"
        for name in (
            *("accumulators", "deviations", "metrics", "stream"),
            *("events/bodies", "events/encounters", "events/lane", "events/watches"),
        )
    ),
    "scenarios/results/channel/tally",
)
"""Modules of other rooms that are compiled."""
SAYS_CONSTANT = "from typing import Final as _Constant"
WRITTEN_OUT = Path("build", "written_out")
"""Where the copy of the sources lies."""


def compiled() -> list[str]:
    """Paths of the modules to compile."""
    of_rooms = (
        str(path)
        for room, left_out in ROOMS.items()
        for path in sorted(Path(room).rglob("*.py"))
        if path.stem not in {"__init__", *left_out}
    )
    return [*of_rooms, *(f"{module}.py" for module in MODULES)]


def with_initialisers(source: str) -> str:
    """Write out `__init__` where `dataclass` would make it, in the blank line after the fields."""
    lines = source.splitlines()
    for kind in ast.walk(ast.parse(source)):
        made = initialiser(kind) if isinstance(kind, ast.ClassDef) else None
        if made is not None:
            blank, text = made
            lines[blank:] = lines[blank:] or [""]  # a class may be the last in its module
            if lines[blank].strip():
                raise ValueError(f"no blank line for {text}")
            lines[blank] = f"    {text}"
    return "\n".join([*lines, ""])


def initialiser(kind: ast.ClassDef) -> tuple[int, str] | None:
    """Line after the fields of a data class (from 0), and the `__init__` that it would be given.

    None for what is no plain data class: one that inherits, is frozen, or says more of a field than
    who makes its default or that it is not asked for.
    """
    decorators = [ast.unparse(one) for one in kind.decorator_list]
    methods = {one.name for one in kind.body if isinstance(one, ast.FunctionDef)}
    if kind.bases or "__init__" in methods or len(decorators) != 1:
        return None
    if not decorators[0].startswith("dataclass(") or "frozen=True" in decorators[0]:
        return None
    blank = 0
    required: list[str] = []
    optional: list[str] = []
    body: list[str] = []
    for one in kind.body:
        if isinstance(one, ast.FunctionDef):
            break
        blank = one.end_lineno or 0
        if not isinstance(one, ast.AnnAssign):
            continue
        name = ast.unparse(one.target)
        says = said_of(one.value)
        if says is None:
            (required if one.value is None else optional).append(ast.unparse(one))
            body.append(f"self.{name} = {name}")
        elif set(says) == {"default_factory"}:
            optional.append(f"{name}: '{ast.unparse(one.annotation)} | None' = None")
            made = f"({says['default_factory']})()"
            body.append(f"self.{name} = {made} if {name} is None else {name}")
        elif says != {"init": "False"}:
            return None
    if "__post_init__" in methods:
        body.append("self.__post_init__()")
    asked = ["self", *(["*"] if "kw_only=True" in decorators[0] else []), *required, *optional]
    return (blank, f"def __init__({', '.join(asked)}) -> None: {'; '.join(body)}") if body else None


def said_of(default: ast.expr | None) -> dict[str | None, str] | None:
    """What `field(...)` says of a field; None where there is a default or none instead."""
    if isinstance(default, ast.Call) and ast.unparse(default.func) == "field":
        return {one.arg: ast.unparse(one.value) for one in default.keywords}
    return None


def with_constants(source: str) -> str:
    """Say of the constants of a module that they are, each in its line: then they need no look-up.

    Constants are capital names to which numbers or texts are assigned, or what is worked out of
    those and of other constants.
    """
    lines, said = source.splitlines(), False
    for one in ast.parse(source).body:
        text = as_constants(one)
        if text:
            text = text if said else f"{SAYS_CONSTANT}; {text}"
            lines[one.lineno - 1 : one.end_lineno] = [text, *[""] * (one.end_lineno - one.lineno)]
            said = True
    return "\n".join([*lines, ""])


def as_constants(statement: ast.stmt) -> str:
    """Write an assignment of constants with their kind; empty for what is none."""
    if not isinstance(statement, ast.Assign) or len(statement.targets) != 1:
        return ""
    target, value = statement.targets[0], statement.value
    pairs = [(target, value)]
    if isinstance(target, ast.Tuple):
        if not isinstance(value, ast.Tuple) or len(value.elts) != len(target.elts):
            return ""
        pairs = list(zip(target.elts, value.elts, strict=True))
    written = []
    for name, what in pairs:
        if not (isinstance(name, ast.Name) and name.id.isupper() and is_constant(what)):
            return ""
        written.append(f"{name.id}: _Constant = {ast.unparse(what)}")
    return "; ".join(written)


def is_constant(value: ast.expr) -> bool:
    """Whether it is a number or a text, or worked out of such and of constants."""
    match value:
        case ast.Constant():
            return isinstance(value.value, int | float | str)
        case ast.Name():
            return value.id.isupper()
        case ast.UnaryOp():
            return is_constant(value.operand)
        case ast.BinOp():
            return is_constant(value.left) and is_constant(value.right)
    return False


def written_out() -> list[str]:
    """Copy the sources and write out in them what is quicker so; the paths of those to compile."""
    for room in ("vehicles", "transport", "scenarios"):
        only_code = ignore_patterns("__pycache__", "*.so", "library")
        copytree(room, WRITTEN_OUT / room, ignore=only_code, dirs_exist_ok=True)
    paths = {WRITTEN_OUT / name for name in compiled()}
    for path in WRITTEN_OUT.rglob("*.py"):
        source = with_constants(path.read_text(encoding="utf-8"))
        path.write_text(with_initialisers(source) if path in paths else source, encoding="utf-8")
    return [str(path) for path in sorted(paths)]


def extensions() -> list[Extension]:
    """What to build; nothing where only names and requirements are asked for."""
    if not {"build_ext", "bdist_wheel", "editable_wheel"} & set(sys.argv):
        return []
    from mypyc.build import mypycify  # noqa: PLC0415 - is here only if it is asked for

    settings = ["--config-file=", "--ignore-missing-imports", "--follow-imports=silent"]
    found: list[Extension] = mypycify(
        [*settings, *written_out()],
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
