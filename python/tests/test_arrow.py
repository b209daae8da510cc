"""Arrow columns through the PyCapsule interface, compared with polars and pyarrow."""

import datetime
import decimal
import gc
import subprocess
import sys

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
import wayfix
from wayfix.arrow import Lists, Table, columns, matrix, sequences
from wayfix.learning import Family, learn
from wayfix.matching import Matcher, RoadNetwork
from wayfix.recognition import Recognizer


class Stream:
    """A table of a package unknown to wayfix; it can be read once."""

    def __init__(self, table):
        self._stream = table.__arrow_c_stream__()

    def __arrow_c_stream__(self, requested_schema=None):
        return self._stream


class OneArray:
    def __init__(self, array):
        self._array = array

    def __arrow_c_array__(self, requested_schema=None):
        return self._array.__arrow_c_array__()


HOURS = [datetime.datetime(2024, 5, 1, 12, tzinfo=datetime.timezone.utc), None, datetime.datetime(1969, 1, 1, 1, tzinfo=datetime.timezone.utc)]
TABLE = pa.table({
    "float": pa.array([1.5, None, -2.0]),
    "single": pa.array([1.5, None, -2.0], pa.float32()),
    "whole": pa.array([1, 2, 3], pa.int16()),
    "gaps": pa.array([1, None, 3]),
    "unsigned": pa.array([1, 2, 2**63], pa.uint64()),
    "truth": pa.array([True, False, True]),
    "unsure": pa.array([True, None, True]),
    "text": pa.array(["a", None, "ü"]),
    "view": pa.array(["a", None, "a longer text than twelve bytes"], pa.string_view()),
    "large": pa.array(["a", None, "ü"], pa.large_string()),
    "word": pa.array(["x", "y", "x"]).dictionary_encode(),
    "gap word": pa.array(["x", None, "x"]).dictionary_encode(),
    "utc": pa.array(HOURS, pa.timestamp("ms", "UTC")),
    "zone": pa.array(HOURS, pa.timestamp("us", "Europe/Berlin")),
    "list": pa.array([[1.0, 2.0], None, [3.0]]),
    "large list": pa.array([[1, 2], [], [3]], pa.large_list(pa.int32())),
    "fixed": pa.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], pa.list_(pa.float32(), 2)),
    "decimal": pa.array([decimal.Decimal("1.5")] * 3),
})
EXPECTED = {
    "float": np.array([1.5, np.nan, -2]),
    "single": np.array([1.5, np.nan, -2], np.float32),
    "whole": np.array([1, 2, 3], np.int16),
    "gaps": np.array([1, np.nan, 3]),
    "unsigned": np.array([1, 2, 2**63], np.uint64),
    "truth": np.array([True, False, True]),
    "unsure": np.array([True, None, True]),
    "text": np.array(["a", None, "ü"]),
    "view": np.array(["a", None, "a longer text than twelve bytes"]),
    "large": np.array(["a", None, "ü"]),
    "word": np.array(["x", "y", "x"], object),
    "gap word": np.array(["x", None, "x"]),
    "utc": np.array(["2024-05-01T12", "NaT", "1969-01-01T01"], "M8[ms]"),
    "zone": np.array(["2024-05-01T12", "NaT", "1969-01-01T01"], "M8[us]"),
    "fixed": np.array([[1, 2], [3, 4], [5, 6]], np.float32),
}


@pytest.mark.parametrize("table", [
    TABLE,
    pa.concat_tables([TABLE.slice(0, 1), TABLE.slice(1, 0), TABLE.slice(1, 2)]),
    pa.concat_tables([TABLE, TABLE]).slice(3, 3),
], ids=["whole", "chunks", "offset"])
def test_columns(table):
    found = columns(Stream(table))
    assert found.keys() == TABLE.column_names
    for name, expected in EXPECTED.items():
        assert found[name].dtype == expected.dtype, name
        np.testing.assert_array_equal(found[name], expected, err_msg=name)
    assert found["decimal"] is None
    assert [list(part) for part in found["list"]] == [[1, 2], [], [3]]
    assert [list(part) for part in found["large list"]] == [[1, 2], [], [3]]
    again = columns(table)
    np.testing.assert_array_equal(again["float"], EXPECTED["float"])


def test_there_and_back():
    rng = np.random.default_rng(0)
    given = Table(
        x=rng.normal(size=3), single=np.float32([1, 2, 3]), n=[1, 2, 3], u=np.uint32([1, 2, 3]),
        yes=np.array([True, False, True]), name=["a", "b", "c"], gap=np.array(["a", None, "c"]),
        when=np.array(["2024-05-01T12", "NaT", "2000"], "M8[s]"), day=np.array(["2024-05-01"] * 3, "M8[D]"),
        rows=rng.normal(size=(3, 2)), parts=[np.arange(2), np.arange(0), np.arange(3)],
    )
    polars, arrow = pl.DataFrame(given), pa.table(given)
    assert polars["x"].to_list() == arrow["x"].to_pylist() == given["x"].tolist()
    assert polars["parts"].to_list() == arrow["parts"].to_pylist() == [[0, 1], [], [0, 1, 2]]
    assert polars["gap"].to_list() == ["a", None, "c"] and polars["yes"].to_list() == [True, False, True]
    assert polars["when"].to_list() == [datetime.datetime(2024, 5, 1, 12), None, datetime.datetime(2000, 1, 1)]
    assert arrow["day"].to_pylist()[0] == datetime.datetime(2024, 5, 1)
    np.testing.assert_array_equal(polars["rows"].to_numpy(), given["rows"])
    for other in (polars, arrow, given):
        back = columns(other)
        np.testing.assert_array_equal(back["x"], given["x"])
        np.testing.assert_array_equal(matrix(back["rows"]), given["rows"])
        np.testing.assert_array_equal(back["u"], [1, 2, 3])
    assert len(pl.DataFrame(Table(x=[]))) == 0 and pa.table(Table()).num_rows == 0


def test_memory_outlives_its_makers():
    rng = np.random.default_rng(0)
    made = [pl.DataFrame(Table(x=rng.normal(size=1000), parts=[np.arange(5)] * 1000)) for _ in range(50)]
    sums = [frame["x"].sum() for frame in made]
    read = [columns(frame)["x"] for frame in made]
    del made
    gc.collect()
    assert sums == pytest.approx([values.sum() for values in read])
    # Also if the process ends first.
    program = "import polars as pl, pyarrow as pa, wayfix.arrow as a; t = a.Table(x=[1.0]); f, g = pl.DataFrame(t), pa.table(t); s = t.__arrow_c_stream__()"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_sequences():
    frame = {"trip": ["b", "a", "b", "a", "b"], "symbol": [0, 1, 1, 0, 1], "x": [0.5, 1, 2, 3, 4]}
    expected = [[0, 1, 1], [1, 0]]
    for kind in (dict, pd.DataFrame, pl.DataFrame, pa.table, lambda of: Stream(pa.table(of))):
        found = sequences(kind(frame), "symbol", by="trip")
        assert [part.tolist() for part in found] == expected
        rows = sequences(kind(frame), ["x", "symbol"], by="trip")
        assert rows[1].tolist() == [[1, 1], [3, 0]]
        assert len(sequences(kind(frame), "x")) == 1
    lists = pl.Series([[0, 1, 1], [1, 0]])
    for column in (lists, lists.to_arrow(), OneArray(lists.to_arrow()), Lists.of(expected)):
        assert [part.tolist() for part in sequences(column)] == expected
    for kind in (pd.DataFrame, pl.DataFrame, pa.table):
        assert [part.tolist() for part in sequences(kind({"y": expected}), "y")] == expected
    assert [part.tolist() for part in sequences(pl.Series([0, 1]))] == [[0, 1]]

    hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
    np.testing.assert_allclose(hmm.score_all(sequences(lists)), [hmm.score([0, 1, 1]), hmm.score([1, 0])])
    out = pl.DataFrame(Table(states=hmm.viterbi_all(sequences(lists))))
    assert out["states"].to_list() == [path.states.tolist() for path in hmm.viterbi_all(expected)]
    learned = learn(wayfix.Hmm([0.5, 0.5], np.eye(2), logarithms=True), sequences(pl.DataFrame(frame), ["x"], by="trip"),
                    Family("exponential", rates=[[1.0], [2.0]]), iterations=1)
    assert learned.iterations == 1


def test_descriptors_in_a_column_of_lists():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(40, 8)).astype(np.float32)
    expected = Recognizer(rows).recording(rows[5:20]).filtered().probabilities
    for column in (pl.Series(rows.tolist()), pa.array(rows.tolist()), pl.Series(rows)):
        found = Recognizer(column).recording(column[5:20]).filtered().probabilities
        np.testing.assert_allclose(found, expected, atol=1e-6)
    with pytest.raises(wayfix.Error, match="list 1 has 1 values, expected 2, the length of the first"):
        Recognizer(pl.Series([[1.0, 2.0], [3.0]]))


def test_points_from_a_stream():
    nodes = {"node": [1, 2], "lat": [0.0, 0.0], "lon": [0.0, 0.01]}
    edges = {"from": [1], "to": [2], "class": ["main"], "oneway": [False]}
    matcher = Matcher(RoadNetwork(Stream(pa.table(nodes)), Stream(pa.table(edges))))
    assert matcher.network.edges["class"].tolist() == ["main", "main"]
    points = pa.table({
        "trip": ["b", "b", "a", "a"], "lat": [1e-5] * 4, "lon": [0.001, 0.002, 0.001, 0.002], "accuracy": [None, 5.0] * 2,
        "time": pa.array([0, 10, 0, 10], pa.timestamp("s", "America/New_York")),
    })
    matched = matcher.match_trips(Stream(points), "trip")
    expected = matcher.match_drive({"time": [0, 10], "lat": [1e-5] * 2, "lon": [0.001, 0.002], "accuracy": [np.nan, 5.0]})
    np.testing.assert_array_equal(matched.probability, np.tile(expected.smoothed().probability, 2))
    out, routes = pl.DataFrame(matched.points()), pa.table(matched.routes())
    assert out["trip"].to_list() == ["b", "b", "a", "a"] and out["edge"].to_list() == matched.edge.tolist()
    assert routes["trip"].to_pylist() == ["b", "a"]


@pytest.mark.parametrize(("call", "message"), [
    (lambda: columns(3), "neither __arrow_c_stream__"),
    (lambda: columns(pl.Series([1])), "is a column, expected a table"),
    (lambda: matrix(pl.DataFrame({"a": [1]})), "is a table, expected a column"),
    (lambda: matrix(pa.array([decimal.Decimal(1)])), "type Decimal128"),
    (lambda: (lambda stream: [columns(stream) for _ in range(2)])(Stream(TABLE)), "taken before"),
    (lambda: columns(type("Odd", (), {"__arrow_c_stream__": lambda self, _=None: TABLE.schema.__arrow_c_schema__()})()), "incorrect name"),
    (lambda: columns(type("Odd", (), {"__arrow_c_stream__": lambda self, _=None: 3})()), "is not a capsule"),
    (lambda: Table(x=[1, 2], y=[1]).__arrow_c_stream__(), "column \"y\" has 1 rows, expected 2"),
    (lambda: Table(x=np.zeros((1, 1, 1))).__arrow_c_stream__(), "3 axes"),
    (lambda: Table(x=Lists(np.zeros(2), np.array([0, 3]))).__arrow_c_stream__(), "offsets do not ascend"),
    (lambda: Table(x=Lists(np.zeros(2), np.array([0, 2, 1, 2]))).__arrow_c_stream__(), "offsets do not ascend"),
    (lambda: sequences({"x": [1]}, "y"), "column 'y' cannot be read"),
    (lambda: sequences({"x": [1], "id": [1, 2]}, "x", by="id"), "2 rows, expected 1"),
    (lambda: Lists.of([[[1]]]), "more than one axis"),
])
def test_hostile_input(call, message):
    with pytest.raises(wayfix.Error, match=message):
        call()


def test_an_error_of_the_producer():
    def batches():
        yield pa.record_batch({"x": [1]})
        raise RuntimeError("the disk is full")

    reader = pa.RecordBatchReader.from_batches(pa.schema({"x": pa.int64()}), batches())
    with pytest.raises(wayfix.Error, match="the disk is full"):
        columns(reader)
