"""Documentation of fields of dataclasses: the docstrings below them, read from the source."""

import ast
from inspect import getsource
from itertools import pairwise
from textwrap import dedent


def field_docs(kind: type) -> dict[str, str]:
    """Map the fields of a dataclass to their docstrings, each in one line.

    Fields without a docstring are left out. `kind` must not be compiled.
    """
    (definition,) = ast.parse(dedent(getsource(kind))).body
    if not isinstance(definition, ast.ClassDef):
        raise TypeError(f"{kind!r} is no class")
    docs = {}
    for statement, following in pairwise(definition.body):
        match statement, following:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str(text))):
                docs[name] = " ".join(text.split())
    return docs
