"""Tables of NumPy columns, and their conversion to pandas, Polars and Arrow."""

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.errors import require
from transport.columns import Lists
from transport.texts import ConvoyError

if TYPE_CHECKING:  # extras
    import pandas
    import polars
    import pyarrow


Array = NDArray[Any]
Values = Array | Lists
SHOWN_ROWS = 5
"""First and last rows that are shown as text or in a notebook."""
TEXT_WIDTH = 100
"""Width of a table as text (characters)."""


class UnknownNameError(ConvoyError, AttributeError, KeyError):
    """A column, vehicle or link that does not exist, and those that do."""

    def __init__(self, kind: str, name: object, known: Sequence[object]) -> None:
        self._text = f"no {kind} {name!r}, allowed {', '.join(map(str, known)) or 'none'}"
        super().__init__(self._text)

    def __str__(self) -> str:
        return self._text


class DataTable:
    """Columns of equal length, by name: `table.speed_mps` and `table["speed_mps"]` are arrays.

    `len(table)` counts the rows, `table.keys()` are the names.

    Names end in the unit. Unknown numbers are NaN in arrays and in pandas, and null in Polars,
    Arrow and files; unknown texts are None. A field with several values per row is an array of
    arrays.
    """

    def __init__(self, columns: Mapping[str, Values]) -> None:
        self._columns = dict(columns)

    @classmethod
    def of_rows(cls, rows: Sequence[Mapping[str, Any]], names: Sequence[str] = ()) -> "DataTable":
        """Make a table of rows with the same names, also without rows; None is unknown."""
        return cls({name: _column([row[name] for row in rows]) for name in names or rows[0]})

    def _values(self, name: str) -> Values:
        if name not in self._columns:
            raise UnknownNameError("column", name, list(self._columns))
        return self._columns[name]

    def __getitem__(self, name: str) -> Array:
        values = self._values(name)
        return _rows_of(values) if isinstance(values, Lists) else values

    def __getattr__(self, name: str) -> Array:
        if name.startswith("_"):  # as looked up by copy, pickle and notebooks
            raise AttributeError(name)
        return self[name]

    def keys(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._columns)

    def items(self) -> Iterator[tuple[str, Array]]:
        """Yield names and columns."""
        return ((name, self[name]) for name in self._columns)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        values = next(iter(self._columns.values()))
        return len(values.offsets) - 1 if isinstance(values, Lists) else len(values)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._columns]

    def to_pandas(self) -> "pandas.DataFrame":
        """Return a DataFrame; raises Error without pandas."""
        require("to_pandas", "pandas", "pandas")
        import pandas  # noqa: PLC0415 - an extra

        return pandas.DataFrame(dict(self.items()))

    def to_polars(self) -> "polars.DataFrame":
        """Return a DataFrame of Polars; raises Error without Polars."""
        require("to_polars", "polars", "polars")
        import polars  # noqa: PLC0415 - an extra

        columns = {
            name: column.tolist() if column.dtype == object else column
            for name, column in self.items()
        }
        return polars.DataFrame(columns, nan_to_null=True)

    def to_arrow(self) -> "pyarrow.Table":
        """Return a table of Arrow; raises Error without pyarrow."""
        require("to_arrow", "tables", "pyarrow")
        import pyarrow  # noqa: PLC0415 - an extra

        return pyarrow.table({name: _arrow(self._values(name)) for name in self})

    def __repr__(self) -> str:
        return f"<DataTable: {len(self)} rows of {', '.join(self)}>"

    def __str__(self) -> str:
        """Show the first and the last rows as text, in blocks of columns that fit a terminal."""
        blocks: list[list[str]] = []
        for column in self._shown():
            width = max(map(len, column))
            cells = [cell.rjust(width) for cell in column]
            if not blocks or len(blocks[-1][0]) + 2 + width > TEXT_WIDTH:
                blocks.append(cells)
            else:
                blocks[-1] = ["  ".join(pair) for pair in zip(blocks[-1], cells, strict=True)]
        return "\n".join([*("\n".join([*block, ""]) for block in blocks), f"{len(self)} rows"])

    def _repr_html_(self) -> str:
        """Show the first and the last rows in a notebook."""
        head, *rows = zip(*self._shown(), strict=True)
        headings = "".join(f"<th>{escape(name)}</th>" for name in head)
        lines = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows]
        body = "".join(f"<tr>{line}</tr>" for line in lines)
        return f"<table><tr>{headings}</tr>{body}</table><p>{len(self)} rows</p>"

    def _shown(self) -> Iterator[list[str]]:
        """Yield name and values of each column in the first and the last rows."""
        height = len(self)
        rows, middle = [*range(height)], [*range(0)]
        if height > 2 * SHOWN_ROWS:
            rows, middle = [*range(SHOWN_ROWS)], [*range(height - SHOWN_ROWS, height)]
        for name, values in self.items():
            first, last = ([_text(values[row]) for row in some] for some in (rows, middle))
            yield [name, *first, *(["…", *last] if last else [])]


def _column(values: Sequence[Any]) -> Array:
    """Make an array: of numbers with NaN for None, or of objects."""
    known = {type(value) for value in values if value is not None}
    if known and known <= {int, float} and (known != {int} or None in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    if known in ({int}, {bool}):
        return np.array(values)
    return np.array([*values, None], dtype=object)[:-1]


def _rows_of(lists: Lists) -> Array:
    rows = np.empty(len(lists.offsets) - 1, dtype=object)
    rows[:] = np.split(lists.values, lists.offsets[1:-1])
    return rows


def _arrow(values: Values) -> "pyarrow.Array[Any]":
    import pyarrow  # noqa: PLC0415 - an extra

    if isinstance(values, Lists):
        return pyarrow.LargeListArray.from_arrays(values.offsets, pyarrow.array(values.values))
    return pyarrow.array(values, from_pandas=True)  # NaN and None are null


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
