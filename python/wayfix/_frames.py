"""Columns of data frames of any kind, and frames of the same kind from columns.

Nothing here needs pandas, polars or pyarrow: their frames are asked for what they are.
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

# Packages whose frames are made for an answer of the same kind.
OUTPUTS = ("pandas", "polars", "pyarrow")

Columns = dict[str, NDArray[Any]]
OptionalColumns = dict[str, NDArray[Any] | None]

# Columns of points, by the names that they may have.
POINTS = {
    "time": ("time", "timestamp"),
    "lat": ("lat", "latitude"),
    "lon": ("lon", "longitude", "lng"),
    "accuracy": ("accuracy",),
    "heading": ("heading", "course", "bearing"),
    "speed": ("speed",),
}
NEEDED = ("time", "lat", "lon")

# Those of networks, and those of `RoadNetwork.edges` that an import has no use for.
NODES = ("node", "id", "lat", "latitude", "lon", "longitude", "name")
EDGES = ("from", "to", "class", "length_m", "metres", "oneway", "speed_kmh")
OWN = ("roundabout", "reverse")


def opened(frame: Any) -> Any:
    """The frame, or the columns of one that has no other way than Arrow's interface; a stream can be read but
    once."""
    if type(frame).__name__ == "LazyFrame":
        raise Error("a frame is a LazyFrame, expected a DataFrame: collect() it first")
    if (isinstance(frame, (Mapping, np.ndarray, arrow.Table)) or package(frame) in OUTPUTS
            or not hasattr(frame, "__arrow_c_stream__")):
        return frame
    return arrow.columns(frame)


def names(frame: Any) -> list[str]:
    """Names of the columns of a frame."""
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
    """One column as an array; dates with a zone are in UTC."""
    try:
        values = frame[name]
        dates: Any = getattr(values, "dt", None)
        if getattr(dates, "tz", None) is not None:
            values = dates.tz_convert("UTC").dt.tz_localize(None)
        array = np.asarray(values)
        # Columns of pandas with its own nulls, which are objects otherwise.
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
    """A column that tells what each row belongs to, in which nothing may be missing."""
    values = column(frame, name)
    if values.dtype.kind in "OfM":
        missing = (np.array([is_missing(value) for value in values.tolist()], bool)
                   if values.dtype.kind == "O" else values != values)
        if missing.any():
            raise Error(f"column {name!r} has no value in row {int(missing.argmax())}, expected one in each")
    return values


def numbers(values: NDArray[Any], name: str) -> NDArray[Any]:
    """Numbers; NaN where they are missing."""
    if values.dtype.kind != "O":
        return values
    try:
        return np.array([np.nan if is_missing(value) else float(value) for value in values.tolist()], float)
    except (TypeError, ValueError) as error:
        raise Error(f"column {name!r} cannot be read: {error}") from error


def moment(value: Any) -> float:
    """One time in seconds, of a number, a date or a text in ISO 8601; in UTC unless it has a zone."""
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
    """Times in seconds; dates and texts count from 1970."""
    if times.dtype.kind == "M":
        missing = np.isnat(times)
        found = times.astype("datetime64[ns]").astype(np.int64) / 1e9
        return np.where(missing, np.nan, found)
    if times.dtype.kind in "OUT":
        return np.array([moment(value) for value in times.tolist()], float)
    if times.dtype.kind not in "fiu" and times.size:
        raise Error(f"times have type {times.dtype}, expected seconds or dates")
    return times


def point_columns(points: Any) -> OptionalColumns:
    """Columns of points, with all names; those that are not known are None."""
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
    """Nodes and edges as the texts of two CSV files."""
    return text(nodes, NODES), text(edges, EDGES)


def text(frame: Any, known: tuple[str, ...]) -> str:
    """A frame as CSV; the columns that are not known are there by name, to be reported."""
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
    """Values as the words of a CSV file; nothing for those that are missing."""
    if values.dtype.kind == "f" and np.isfinite(values).all() and (values % 1 == 0).all():
        # Whole numbers, as from a frame that keeps integers as floats.
        return [str(int(value)) for value in values.tolist()]
    return [word(value) for value in values.tolist()]


def word(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return repr(value) if isinstance(value, float) else str(value)


def frame_like(frame: Any, columns: Columns) -> Any:
    """A new frame of the same kind."""
    match package(frame):
        case "pyarrow":
            return sys.modules["pyarrow"].table(columns)
        case "pandas" | "polars" as name:
            return sys.modules[name].DataFrame(columns)
        case _:
            return arrow.Table(columns) if isinstance(frame, arrow.Table) else columns


def with_columns(frame: Any, columns: Columns) -> Any:
    """The frame with more columns."""
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
    """Raises an error if an answer has the name of a column that is there."""
    if clash := next((name for name in columns if name in there), None):
        raise Error(f"points have a column {clash!r}, as the answers do: give these a prefix")


def package(frame: Any) -> str:
    """The package that a frame is of."""
    return type(frame).__module__.partition(".")[0]
