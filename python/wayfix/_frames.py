"""Columns of data frames of any kind, and frames of the same kind from columns.

Nothing here needs pandas, polars or pyarrow: a frame is recognised by its class's module, and a package is used only
if a frame of it was given, so that it is imported already.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Mapping
from datetime import UTC, date, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import arrow
from ._wayfix import Error

# Packages for which answers are frames of the same kind.
OUTPUTS = ("pandas", "polars", "pyarrow")

Columns = dict[str, NDArray[Any]]
OptionalColumns = dict[str, NDArray[Any] | None]

# Columns of points, with the names that each may have.
POINTS = {
    "time": ("time", "timestamp"),
    "lat": ("lat", "latitude"),
    "lon": ("lon", "longitude", "lng"),
    "accuracy": ("accuracy",),
    "heading": ("heading", "course", "bearing"),
    "speed": ("speed",),
}
NEEDED = ("time", "lat", "lon")

# Columns of networks, and columns of `RoadNetwork.edges` that an import does not use.
NODES = ("node", "id", "lat", "latitude", "lon", "longitude", "name")
EDGES = ("from", "to", "class", "length_m", "metres", "oneway", "speed_kmh")
OWN = ("roundabout", "reverse")


def opened(frame: Any) -> Any:
    """Returns the frame itself, or the columns of one that can be read only through Arrow's interface.

    A stream can be read only once, so callers open a frame before they look at its names.
    """
    if type(frame).__name__ == "LazyFrame":
        raise Error("a frame is a LazyFrame, expected a DataFrame: collect() it first")
    if (isinstance(frame, (Mapping, np.ndarray, arrow.Table)) or package(frame) in OUTPUTS
            or not hasattr(frame, "__arrow_c_stream__")):
        return frame
    return arrow.columns(frame)


def names(frame: Any) -> list[str]:
    """Returns the names of the columns of a frame."""
    if isinstance(frame, Mapping):
        return [str(name) for name in frame]
    for attribute in ("column_names", "columns"):  # pyarrow's `columns` are the arrays
        found = getattr(frame, attribute, None)
        if found is not None and not callable(found):
            return [str(name) for name in found]
    if isinstance(frame, np.ndarray) and frame.dtype.names:
        return list(frame.dtype.names)
    raise Error(f"a frame is a {type(frame).__name__}, expected a data frame or a dict of arrays")


def column(frame: Any, name: str) -> NDArray[Any]:
    """Returns one column as an array; dates with a zone are in UTC."""
    try:
        values = frame[name]
        # Numpy has no zones: pandas would give an array of Timestamps.
        dates: Any = getattr(values, "dt", None)
        if getattr(dates, "tz", None) is not None:
            values = dates.tz_convert("UTC").dt.tz_localize(None)
        array = np.asarray(values)
        # Pandas' columns with its own nulls (Int64, Float64, …) become objects in `asarray`.
        kind = getattr(getattr(values, "dtype", None), "kind", "O")
        if array.dtype.kind == "O" and kind in "iuf":
            array = values.to_numpy("float64", na_value=np.nan)
        elif array.dtype.kind == "O" and kind == "M":
            array = values.to_numpy("datetime64[ns]")
    except Error:
        raise
    except Exception as error:
        raise Error(f"column {name!r} cannot be read: {error}") from error
    if array.ndim != 1:
        raise Error(f"column {name!r} has {array.ndim} axes, expected 1")
    return array


def is_missing(value: Any) -> bool:
    """True for None, NaN and the like."""
    return value is None or type(value).__name__ in ("NAType", "NaTType") or bool(value != value)


def ids(frame: Any, name: str) -> NDArray[Any]:
    """Returns a column that groups the rows; a missing value is an error."""
    values = column(frame, name)
    # Integers and numpy's own texts have no missing values.
    if values.dtype.kind in "OfM":
        missing = (np.array([is_missing(value) for value in values.tolist()], bool)
                   if values.dtype.kind == "O" else values != values)
        if missing.any():
            raise Error(f"column {name!r} has no value in row {int(missing.argmax())}, expected one in each")
    return values


def numbers(values: NDArray[Any], name: str) -> NDArray[Any]:
    """Returns numbers, with NaN for missing ones."""
    if values.dtype.kind != "O":
        return values
    try:
        return np.array([np.nan if is_missing(value) else float(value) for value in values.tolist()], float)
    except (TypeError, ValueError) as error:
        raise Error(f"column {name!r} cannot be read: {error}") from error


def moment(value: Any) -> float:
    """Returns a time in seconds, from a number, a date or a text in ISO 8601; in UTC unless it has a zone."""
    if is_missing(value):
        return np.nan
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value)
        except ValueError as error:
            raise Error(f"the time is {value!r}, expected seconds, a date, or a text in ISO 8601") from error
    if isinstance(value, datetime):
        return (value if value.tzinfo else value.replace(tzinfo=UTC)).timestamp()
    if isinstance(value, (date, np.datetime64)):
        return float(seconds(np.array([value], "datetime64[ns]"))[0])
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise Error(f"the time is {value!r}, expected seconds, a date, or a text in ISO 8601") from error


def seconds(times: NDArray[Any]) -> NDArray[Any]:
    """Returns times in seconds; those of dates and texts count from 1970."""
    if times.dtype.kind == "M":
        # "Not a time" is the smallest integer, which must not become a year.
        missing = np.isnat(times)
        found = times.astype("datetime64[ns]").astype(np.int64) / 1e9
        return np.where(missing, np.nan, found)
    if times.dtype.kind in "OUT":
        return np.array([moment(value) for value in times.tolist()], float)
    if times.dtype.kind not in "fiu" and times.size:
        raise Error(f"times have type {times.dtype}, expected seconds or dates")
    return times


def point_columns(points: Any) -> OptionalColumns:
    """Returns the columns of points under their first names; columns that are not there are None."""
    points = opened(points)
    there = names(points)
    found: dict[str, Any] = {}
    for wanted, possible in POINTS.items():
        name = next((name for name in possible if name in there), None)
        if name is None and wanted in NEEDED:
            raise Error(f"points have no column {' or '.join(possible)}, but {', '.join(there)}")
        if name is None:
            found[wanted] = None
        else:
            values = column(points, name)
            found[wanted] = seconds(values) if wanted == "time" else numbers(values, name)
    return found


def network_texts(nodes: Any, edges: Any) -> tuple[str, str]:
    """Returns nodes and edges as the texts of two CSV files."""
    return text(nodes, NODES), text(edges, EDGES)


def text(frame: Any, known: tuple[str, ...]) -> str:
    """Returns a frame as CSV. Unknown columns have names and no values, so that the import can report them."""
    frame = opened(frame)
    there = [name for name in names(frame) if name not in OWN]
    columns = [words(column(frame, name)) if name in known else None for name in there]
    count = max((len(found) for found in columns if found is not None), default=0)
    for name, found in zip(there, columns, strict=True):
        if found is not None and len(found) != count:
            raise Error(f"column {name!r} has {len(found)} rows, expected {count}")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(there)
    writer.writerows(zip(*(found or [""] * count for found in columns), strict=True))
    return out.getvalue()


def words(values: NDArray[Any]) -> list[str]:
    """Returns values as the words of a CSV file; missing ones are empty."""
    if values.dtype.kind == "f" and np.isfinite(values).all() and (values % 1 == 0).all():
        # Ids of a frame that keeps integers as floats: "3.0" would not be read as an id.
        return [str(int(value)) for value in values.tolist()]
    return [word(value) for value in values.tolist()]


def word(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    # `repr` of a float is the shortest text that is read back as the same bits.
    return repr(value) if isinstance(value, float) else str(value)


def frame_like(frame: Any, columns: Columns) -> Any:
    """Returns a new frame of the same kind as `frame`."""
    match package(frame):
        case "pyarrow":
            return sys.modules["pyarrow"].table(columns)
        case "pandas" | "polars" as name:
            return sys.modules[name].DataFrame(columns)
        case _:
            return arrow.Table(columns) if isinstance(frame, arrow.Table) else columns


def with_columns(frame: Any, columns: Columns) -> Any:
    """Returns the frame with additional columns."""
    check_new(names(frame), columns)
    match package(frame):
        case "pandas":
            return frame.assign(**columns)
        case "polars":
            return frame.with_columns(**{k: sys.modules["polars"].Series(k, v) for k, v in columns.items()})
        case "pyarrow":
            for name, values in columns.items():
                frame = frame.append_column(name, sys.modules["pyarrow"].array(values))
            return frame
        case _:
            all_columns = {name: frame[name] for name in names(frame)} | columns
            return arrow.Table(all_columns) if isinstance(frame, arrow.Table) else all_columns


def check_new(there: list[str], columns: Columns) -> None:
    """Raises an error if a new column has the name of an existing one."""
    if clash := next((name for name in columns if name in there), None):
        raise Error(f"both the points and the answers have a column {clash!r}: give the answers a prefix")


def package(frame: Any) -> str:
    """Returns the name of the package that a frame belongs to."""
    return type(frame).__module__.partition(".")[0]
