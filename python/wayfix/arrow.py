"""Arrow columns from and for any package with the PyCapsule interface: polars, pandas, pyarrow, duckdb and others.
None of them is required.

    import polars as pl
    frame = pl.DataFrame({"frames": [[0, 0, 1], [1]]})
    hmm.viterbi_all(sequences(frame["frames"]))     # a list column: one sequence a row
    sequences(frame, "symbol", by="trip")           # one sequence for each trip, in the order of the rows
    pl.DataFrame(Table(trip=names, states=paths))   # and back: a list column again
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _frames, _trips
from ._wayfix import Error, Smoothed, arrow_stream, read_arrow

__all__ = ["Lists", "Table", "columns", "matrix", "sequences"]


class Lists:
    """Column of lists: the values of all lists, and the offsets of each.

    Attributes
    ----------
    values : array
        Values of all lists, one after another.
    offsets : array of int, shape (lists + 1,)
        List i is `values[offsets[i]:offsets[i + 1]]`.

    Examples
    --------
    >>> import numpy as np
    >>> from wayfix.arrow import Lists
    >>> lists = Lists.of([[1.0, 2.0], [], [3.0]])
    >>> lists.offsets, lists[0]
    (array([0, 2, 2, 3]), array([1., 2.]))
    """

    def __init__(self, values: NDArray[Any], offsets: NDArray[np.int64]) -> None:
        self.values, self.offsets = values, offsets

    @classmethod
    def of(cls, arrays: Sequence[Any]) -> Lists:
        """Returns a column of arrays with one axis each."""
        parts = [np.asarray(array) for array in arrays]
        if any(part.ndim != 1 for part in parts):
            raise Error("a list has more than one axis, expected 1")
        # The type of an empty list says nothing, and would change that of the others.
        typed = [part for part in parts if part.size] or parts[:1]
        values = np.concatenate(typed) if typed else np.zeros(0)
        return cls(values, np.cumsum([0, *map(len, parts)], dtype=np.int64))

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, index: int) -> NDArray[Any]:
        # A range counts negative indices from the end, and raises IndexError beyond it.
        index = range(len(self))[index]
        return self.values[self.offsets[index]:self.offsets[index + 1]]

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return (self[index] for index in range(len(self)))

    def __repr__(self) -> str:
        return f"<Lists: {len(self)} of {len(self.values)} values>"


class Table:
    """Columns by name, which other packages read as a table (`__arrow_c_stream__`).

    A column is an array of numbers, truth values, dates or texts, a matrix (lists of one length), or
    `Lists`; a list of arrays, of paths or of anything with `states` becomes `Lists`.

    Examples
    --------
    >>> import numpy as np
    >>> import wayfix
    >>> from wayfix.arrow import Table, columns
    >>> hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
    >>> table = Table(trip=["a", "b"], states=hmm.viterbi_all([[0, 1, 1, 1], [0]]))
    >>> columns(table)["states"][0]  # by the interface, as another package would
    array([0, 1, 1, 1])
    """

    def __init__(self, columns: Mapping[str, Any] | None = None, /, **named: Any) -> None:
        self._columns = {str(name): values for name, values in {**(columns or {}), **named}.items()}

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""
        return list(self._columns)

    def keys(self) -> list[str]:
        """Names of the columns, for `dict(table)`."""
        return list(self._columns)

    def __getitem__(self, name: str) -> Any:
        return self._columns[name]

    # The class is not a Mapping: packages would take it for a dictionary, and not ask for the stream.
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return arrow_stream({name: exported(values) for name, values in self._columns.items()})

    def __repr__(self) -> str:
        return f"<Table: {', '.join(self._columns)}>"


def exported(values: Any) -> Any:
    """Returns a column in a form that the compiled part accepts."""
    if isinstance(values, Lists):
        return values.values, values.offsets
    if isinstance(values, (list, tuple)) and values and not isinstance(values[0], (str, bytes)):
        parts: list[Any] = [getattr(value, "states", value) for value in values]
        if isinstance(values[0], Smoothed) or np.ndim(parts[0]) > 1:
            raise Error("a column is a list of matrices, expected arrays with one axis, such as "
                        "[smoothed.probabilities[:, 0] for smoothed in ...]")
        if any(np.ndim(part) == 1 for part in parts):
            return exported(Lists.of(parts))
    return np.asarray(values)


def columns(data: Any) -> Table:
    """Returns the columns of a table with `__arrow_c_stream__`: arrays, matrices and `Lists`.

    Nulls become NaN, NaT or None, and empty lists; dates are in UTC. A column of another type, such as decimals or
    structures, is None.
    """
    found = read_arrow(data)
    if not isinstance(found, dict):
        raise Error(f"a {type(data).__name__} is a column, expected a table")
    return Table({name: opened(values) for name, values in found.items()})


def opened(values: Any) -> Any:
    return Lists(*values) if isinstance(values, tuple) else values


def one_column(data: Any) -> Any:
    """Returns one column: an array, a matrix or `Lists`."""
    if isinstance(data, (np.ndarray, Lists)):
        return data
    found = read_arrow(data)
    if isinstance(found, dict):
        raise Error(f"a {type(data).__name__} is a table, expected a column")
    return opened(found)


def matrix(data: Any) -> NDArray[Any]:
    """Returns a column of lists of one length, such as descriptors, as a matrix with a row for each list."""
    found = one_column(data)
    if not isinstance(found, Lists):
        return np.asarray(found)
    lengths = np.diff(found.offsets)
    if len(lengths) == 0:
        return found.values.reshape(0, 0)
    if (other := np.flatnonzero(lengths != lengths[0])).size:
        row = int(other[0])
        raise Error(f"list {row} has {lengths[row]} values, expected {lengths[0]}, the length of the first")
    return found.values.reshape(len(found), lengths[0])


def sequences(data: Any, column: str | Sequence[str] | None = None, *, by: str | None = None
              ) -> list[NDArray[Any]]:
    """Returns sequences for `score_all`, `smooth_all`, `viterbi_all` and `learn`.

    Parameters
    ----------
    data : column or table
        A column of lists, each of which is a sequence; a column of numbers, which is one sequence; or a table.
    column : str or list of str
        Name of the table's column, or names for several numbers at each step.
    by : str, optional
        Name of the column with the sequence of each row. The rows of a sequence need not be consecutive; sequences
        are in the order of their first rows. Without it, all rows are one sequence.

    Examples
    --------
    >>> from wayfix.arrow import Table, sequences
    >>> table = Table(trip=["b", "a", "b"], symbol=[0, 1, 1])
    >>> sequences(table, "symbol", by="trip")
    [array([0, 1]), array([1])]
    """
    if column is None:
        return as_sequences(data)
    data = _frames.opened(data)
    if isinstance(column, str):
        if isinstance(lists := as_lists(data, column), Lists):
            return list(lists)
        values = _frames.column(data, column)
    else:
        values = np.stack([_frames.column(data, name) for name in column], axis=1)
    if by is None:
        return [values]
    _, codes = _trips.numbered(_frames.ids(data, by))
    if len(codes) != len(values):
        raise Error(f"column {by!r} has {len(codes)} rows, expected {len(values)}")
    # Stable, so that rows keep their order within a sequence; a sequence ends where the code changes.
    rows = np.argsort(codes, kind="stable")
    return np.split(values[rows], np.flatnonzero(np.diff(codes[rows])) + 1) if len(rows) else []


def as_sequences(data: Any) -> list[NDArray[Any]]:
    """Returns the lists of a column, or the column as the only sequence."""
    found = one_column(data)
    return list(found) if isinstance(found, Lists) else [np.asarray(found)]


def as_lists(frame: Any, name: str) -> Any:
    """Returns a column of lists as `Lists`, and None for any other column."""
    if name not in _frames.names(frame):
        return None
    values = frame[name]
    if isinstance(values, Lists):
        return values
    # Columns of pandas have the interface only with pyarrow.
    if hasattr(values, "__arrow_c_stream__") and _frames.package(values) != "pandas":
        found = one_column(values)
        return found if isinstance(found, Lists) else None
    first = next(iter(values), None)
    return Lists.of(list(values)) if isinstance(first, (list, tuple, np.ndarray)) else None
