"""Trips of a data frame: sorted, matched, and back in the order of the rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _frames
from ._frames import Columns, OptionalColumns
from ._wayfix import Error, RoadAnswers

if TYPE_CHECKING:
    from ._wayfix import Matcher


Threads = tuple[int, Callable[[int, int], object] | None]
Order = tuple[OptionalColumns, NDArray[Any], NDArray[Any], NDArray[Any]]


def order_of(points: Any, trip: str | None) -> Order:
    """Sorts points by trip and time.

    Returns the columns of the points; the names of the trips, in the order of their first rows; the rows by trip and
    time; and the offsets of the trips among these rows. Rows without a time or a position are left out, and so are
    rows with the trip and time of an earlier row.
    """
    points = _frames.opened(points)
    columns = _frames.point_columns(points)
    time = required(columns)
    count = len(time)
    for name, values in columns.items():
        if values is not None and len(values) != count:
            raise Error(f"column {name!r} has {len(values)} rows, expected {count}")
    if trip is None:
        names, codes = np.array([None]), np.zeros(count, int)
    else:
        if trip not in _frames.names(points):
            raise Error(f"points have no column {trip!r}, but {', '.join(_frames.names(points))}")
        values = _frames.ids(points, trip)
        if len(values) != count:
            raise Error(f"column {trip!r} has {len(values)} rows, expected {count}")
        names, codes = numbered(values)
    missing = [np.isnan(values) for name, values in columns.items() if name in _frames.NEEDED and values is not None]
    rows = np.flatnonzero(~np.logical_or.reduce(missing))
    # By trip, then by time. `lexsort` is stable, so of equal times the first row stays first.
    rows = rows[np.lexsort((time[rows], codes[rows]))]
    times, sorted_codes = time[rows], codes[rows]
    same = np.zeros(len(rows), bool)
    same[1:] = (times[1:] == times[:-1]) & (sorted_codes[1:] == sorted_codes[:-1])
    rows, sorted_codes = rows[~same], sorted_codes[~same]
    # A trip whose rows were all left out has two equal offsets: it is matched as a drive without points.
    trips = len(names) if count else 0
    return columns, names[:trips], rows, np.searchsorted(sorted_codes, np.arange(trips + 1))


def numbered(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Returns the distinct values in the order of their first rows, and for each row the number of its value."""
    try:
        distinct, first, codes = np.unique(values, return_index=True, return_inverse=True)
    except TypeError:  # values of several types cannot be sorted, as with None among texts
        numbers: dict[Any, int] = {}
        codes = np.array([numbers.setdefault(value, len(numbers)) for value in values.tolist()], int)
        distinct = np.empty(len(numbers), object)
        distinct[:] = list(numbers)
        return distinct, codes
    # `unique` sorts; `rank` is the inverse permutation of the order of first rows.
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return distinct[order], rank[codes.reshape(-1)]


def required(columns: OptionalColumns) -> NDArray[Any]:
    """Returns the times, a column that `point_columns` requires."""
    time = columns["time"]
    assert time is not None
    return time


def taken(columns: OptionalColumns, rows: NDArray[Any]) -> OptionalColumns:
    return {name: None if values is None else values[rows] for name, values in columns.items()}


def sorted_trips(points: Any, trip: str | None) -> tuple[OptionalColumns, list[int]]:
    """Returns the columns of points sorted by trip and time, and the offsets of trips that have a point."""
    columns, _, rows, offsets = order_of(points, trip)
    # Trips without a point have equal offsets; `unique` keeps one of them.
    return taken(columns, rows), np.unique(offsets).tolist()


def ends_of(edges: Columns, edge: NDArray[Any]) -> Columns:
    """Returns the ids of the nodes of edges; -1 off the road."""
    on_road = edge >= 0
    ends = {}
    for name in ("from", "to"):
        ids = np.full(len(edge), -1, np.int64)
        ids[on_road] = edges[name][edge[on_road]].astype(np.int64)
        ends[name] = ids
    return ends


class MatchedTrips:
    """Trips on roads, made by `Matcher.match_trips(points, trip)`.

    Arrays have an entry for each row that was given, in the order of the rows:

    Attributes
    ----------
    edge : array of int
        Number of the most probable edge; -1 off the road, and for rows without an answer.
    metres_along, probability, entropy, off_road, positions
        As in `RoadAnswers`; NaN for rows without an answer.
    log_normalizers : array
        Log-density of each point given all earlier points, with lengths in metres.
    log_likelihoods : dict
        Log-likelihood of each trip.
    skipped : int
        Number of rows without an answer because they have no time or no position, or because an earlier row of
        their trip has the same time.
    failed : dict
        Reason for each trip that could not be matched.
    unmatched : list
        Trips without a point on a road: all edges are -1, with the probability of being off the road, which is 1
        if no road is near.
    """

    def __init__(self, matcher: Matcher, points: Any, trip: str | None, estimator: str, lag: int | None,
                 errors: str, threads: Threads) -> None:
        if errors not in ("raise", "skip"):
            raise Error(f"errors is {errors!r}, expected 'raise' or 'skip'")
        points = _frames.opened(points)
        columns, names, rows, offsets = order_of(points, trip)
        found = matcher._match(taken(columns, rows), offsets.tolist(), estimator, lag, errors == "skip",
                                *threads)
        named = names.tolist()
        # Offsets count sorted rows; `rows` leads back to the rows that were given.
        self.failed: dict[Any, str] = {}
        for number, point, problem in found["failed"]:
            at = "" if point is None else f" (row {rows[offsets[number] + point]})"
            self.failed[named[number]] = problem + at
        if errors == "raise" and self.failed:
            # Drives fail in order, so this is the first, whatever the number of threads.
            name, problem = next(iter(self.failed.items()))
            error = Error(problem if trip is None else f"trip {name!r}: {problem}")
            error.sequence, point, _ = found["failed"][0]
            error.step = None if point is None else point + 1
            raise error
        self._points, self._trip, self._names = points, trip, names
        count = len(required(columns))
        answers: RoadAnswers = found["answers"]
        self.skipped = count - len(rows)

        # Answers are in the order of the sorted rows; here they return to the order of the frame.
        def spread(values: NDArray[Any], nothing: float = np.nan) -> NDArray[Any]:
            out = np.full((count, *values.shape[1:]), nothing, values.dtype)
            out[rows] = values
            return out

        self.edge = spread(answers.edge, -1)
        self.metres_along = spread(answers.metres_along)
        self.positions = spread(answers.positions)
        self.probability = spread(answers.probability)
        self.entropy = spread(answers.entropy)
        self.off_road = spread(answers.off_road)
        self.log_normalizers = spread(found["log_normalizers"])
        self.log_likelihoods = dict(zip(named, found["log_likelihoods"].tolist(), strict=True))
        # `repeat` gives the trip of each sorted row, since `diff` of the offsets is its number of rows.
        on_road = np.zeros(len(names), bool)
        on_road[np.repeat(np.arange(len(names)), np.diff(offsets))[answers.edge >= 0]] = True
        self.unmatched = [name for name in names[~on_road].tolist() if name not in self.failed]
        edges = matcher.network.edges
        self._ends = ends_of(edges, self.edge)
        drive, edge = found["route_drive"], found["route_edge"]
        self._drive = drive
        # `drive` ascends, so the first position of a value is where its route begins, and `seq` counts from there.
        self._routes: Columns = {
            "seq": np.arange(len(drive)) - np.searchsorted(drive, drive),
            "edge": edge,
            **ends_of(edges, edge),
            "enter_m": found["route_enter"],
            "exit_m": found["route_exit"],
        }

    def points(self, prefix: str = "") -> Any:
        """Returns the points that were given, in a frame of the same kind, with the columns `edge`,
        `from`, `to` (ids of nodes), `metres_along`, `matched_lat`, `matched_lon`, `probability` and
        `off_road`.

        Parameters
        ----------
        prefix : str
            Prefix of the names of these columns, for points that have a column of the same name.
        """
        columns = {
            "edge": self.edge,
            **self._ends,
            "metres_along": self.metres_along,
            "matched_lat": self.positions[:, 0].copy(),
            "matched_lon": self.positions[:, 1].copy(),
            "probability": self.probability,
            "off_road": self.off_road,
        }
        return _frames.with_columns(self._points, {prefix + name: column for name, column in columns.items()})

    def routes(self, prefix: str = "") -> Any:
        """Returns the most probable routes in a frame of the same kind.

        There is a row for each edge or stretch off the road: the trip, `seq` from 0, `edge` (-1 off the road),
        `from`, `to`, and `enter_m`, `exit_m`, in metres from the start of the edge. `prefix` is as in `points`.
        """
        trips: Columns = {} if self._trip is None else {self._trip: self._names[self._drive]}
        columns = {prefix + name: column for name, column in self._routes.items()}
        _frames.check_new(list(trips), columns)
        return _frames.frame_like(self._points, trips | columns)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return f"<MatchedTrips: {len(self)} trips, {len(self.edge)} points, {len(self.failed)} failed>"


def match_trips(matcher: Matcher, points: Any, trip: str | None, estimator: str, lag: int | None,
                errors: str, threads: Threads) -> MatchedTrips:
    return MatchedTrips(matcher, points, trip, estimator, lag, errors, threads)
