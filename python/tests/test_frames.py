"""Columns of points as users have them: missing values, dates of all types, clashing names, and threads."""

import datetime
import pickle

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
import wayfix
from test_matching import drive, town
from wayfix.arrow import Table, sequences
from wayfix.matching import Matcher, RoadNetwork


@pytest.fixture(scope="module")
def matcher():
    return Matcher(RoadNetwork(*town()))


@pytest.fixture
def frame(matcher):
    points, _, _ = drive(0, matcher.network)
    return pd.DataFrame(points).assign(id="a")


@pytest.mark.parametrize("name", ["lat", "lon", "time"])
def test_rows_without_position(matcher, frame, name):
    rest = matcher.match_trips(frame.drop(index=[3, 7]), "id")
    for missing in (np.nan, None):
        gaps = frame.astype({name: object})
        gaps.loc[[3, 7], name] = missing
        matched = matcher.match_trips(gaps, "id")
        assert (matched.edge[[3, 7]] == -1).all() and np.isnan(matched.probability[[3, 7]]).all()
        np.testing.assert_array_equal(np.delete(matched.probability, [3, 7]), rest.probability)
        assert matched.skipped == 2 and not matched.failed
    whole = matcher.learn(frame.drop(index=[3, 7]), "id", iterations=1).model
    assert matcher.learn(gaps, "id", iterations=1).model == whole
    nothing = matcher.match_trips(gaps.assign(lat=np.nan), "id", errors="skip")
    assert list(nothing.failed) == ["a"] and nothing.skipped == len(frame)


@pytest.mark.parametrize("missing", [None, np.nan, pd.NA])
def test_rows_without_an_id(matcher, frame, missing):
    frame = frame.astype({"id": object})
    frame.loc[4, "id"] = missing
    with pytest.raises(wayfix.Error, match="column 'id' has no value in row 4"):
        matcher.match_trips(frame, "id")
    with pytest.raises(wayfix.Error, match="column 'id' has no value in row 4"):
        sequences(frame, "lat", by="id")
    with pytest.raises(wayfix.Error, match="column 'id' has no value in row 1"):
        sequences({"id": [1.0, np.nan], "x": [0, 1]}, "x", by="id")


def test_dates_of_all_kinds(matcher, frame):
    expected = matcher.match_trips(frame, "id").probability
    start = datetime.datetime(2024, 5, 1, tzinfo=datetime.timezone(datetime.timedelta(hours=2)))
    zoned = [start + datetime.timedelta(seconds=second) for second in frame["time"]]
    texts = [time.isoformat() for time in zoned]
    plain = [time.astimezone(datetime.UTC).replace(tzinfo=None) for time in zoned]
    columns = [zoned, texts, plain, np.array(texts, object), pd.Series(texts), pd.Series(zoned, dtype=object),
               [time.isoformat().replace("+00:00", "Z") for time in plain], pd.Series(pd.to_datetime(texts))]
    lists = {name: frame[name].tolist() for name in ("id", "lat", "lon")}
    for time in columns:
        np.testing.assert_array_equal(matcher.match_trips(lists | {"time": time}, "id").probability, expected)
    np.testing.assert_array_equal(matcher.match_trips(frame.assign(time=texts), "id").probability, expected)
    polars = pl.DataFrame({**lists, "time": texts})
    np.testing.assert_array_equal(matcher.match_trips(polars, "id").probability, expected)
    with pytest.raises(wayfix.Error, match="the time is 'noon', expected seconds, a date, or a text in ISO 8601"):
        matcher.match_trips(lists | {"time": ["noon"] * len(frame)}, "id")
    live = matcher.start(0, frame["lat"][0], frame["lon"][0])
    live.step(2, frame["lat"][1], frame["lon"][1])
    for first, second in [zoned[:2], texts[:2], plain[:2], list(pd.to_datetime(texts[:2])),
                          list(np.array(plain[:2], "datetime64[us]"))]:
        vehicle = matcher.start(first, frame["lat"][0], frame["lon"][0])
        vehicle.step(second, frame["lat"][1], frame["lon"][1])
        assert vehicle.live == live.live


KINDS = {"pandas": lambda frame: frame, "polars": pl.from_pandas, "pyarrow": pa.Table.from_pandas,
         "dict": lambda frame: {name: frame[name].to_numpy() for name in frame}}


@pytest.mark.parametrize("kind", KINDS)
def test_columns_are_not_overwritten(matcher, frame, kind):
    given = KINDS[kind](frame.assign(edge=7, probability=0.5))
    matched = matcher.match_trips(given, "id")
    with pytest.raises(wayfix.Error, match="both the points and the answers have a column 'edge': give the answers a prefix"):
        matched.points()
    points = matched.points(prefix="road_")
    assert set(np.asarray(points["edge"])) == {7}
    np.testing.assert_array_equal(np.asarray(points["road_edge"]), matched.edge)
    named = matcher.match_trips(KINDS[kind](frame.rename(columns={"id": "from"})), "from")
    with pytest.raises(wayfix.Error, match="'from'"):
        named.routes()
    routes = named.routes(prefix="road_")
    assert set(np.asarray(routes["from"])) == {"a"} and (np.asarray(routes["road_from"]) >= 0).all()


def test_trips_far_from_all_roads(matcher, frame):
    far = frame.assign(id="far", lat=frame["lat"] + 3)
    matched = matcher.match_trips(pd.concat([frame, far], ignore_index=True), "id")
    assert matched.unmatched == ["far"] and not matched.failed
    assert (matched.off_road[len(frame):] == 1).all()


def test_late_answers_need_a_lag(matcher, frame):
    with pytest.raises(wayfix.Error, match="late answers need a lag"):
        matcher.match_trips(frame, "id", estimator="late")
    late = matcher.match_trips(frame, "id", estimator="late", lag=2)
    np.testing.assert_allclose(late.probability, matcher.match_drive(frame).late(2).probability)


def test_threads_and_progress(matcher, frame):
    frame = pd.concat([frame.assign(id=number) for number in range(70)], ignore_index=True)
    frame.loc[frame.index[frame["id"].isin([21, 40])][::5], "lat"] = 95.0
    told = []
    one = matcher.match_trips(frame, "id", errors="skip", progress=lambda done, count: told.append((done, count)))
    assert told[-1] == (70, 70) and list(one.failed) == [21, 40]
    for n_jobs in (2, -1):
        many = matcher.match_trips(frame, "id", errors="skip", n_jobs=n_jobs)
        np.testing.assert_array_equal(many.probability, one.probability)
        np.testing.assert_array_equal(many.routes()["edge"], one.routes()["edge"])
        np.testing.assert_array_equal(many.routes()["id"], one.routes()["id"])
        assert many.failed == one.failed
        with pytest.raises(wayfix.Error, match="trip 21"):
            matcher.match_trips(frame, "id", n_jobs=n_jobs)
    with pytest.raises(wayfix.Error, match="n_jobs is 0"):
        matcher.match_trips(frame, "id", n_jobs=0)

    def fails(done, count):
        raise KeyError(done)

    with pytest.raises(KeyError):
        matcher.match_trips(frame, "id", errors="skip", progress=fails)


def test_matched_trips_and_learned_models_are_pickled(matcher, frame):
    matched = matcher.match_trips(frame, "id")
    again = pickle.loads(pickle.dumps(matched))
    pd.testing.assert_frame_equal(again.points(), matched.points())
    pd.testing.assert_frame_equal(again.routes(), matched.routes())
    assert again.log_likelihoods == matched.log_likelihoods
    learned = matcher.learn(frame, "id", iterations=1)
    again = pickle.loads(pickle.dumps(learned))
    names = ("model", "iterations", "converged", "log_likelihood", "points", "held_out", "median_interval", "at_limits")
    assert [getattr(again, name) for name in names] == [getattr(learned, name) for name in names]


def test_what_is_no_frame_or_column(matcher, frame):
    with pytest.raises(wayfix.Error, match=r"LazyFrame, expected a DataFrame: collect\(\) it first"):
        matcher.match_trips(pl.from_pandas(frame).lazy(), "id")
    with pytest.raises(wayfix.Error, match="LazyFrame"):
        sequences(pl.from_pandas(frame).lazy(), "lat", by="id")
    hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
    smoothed = hmm.smooth_all([[0, 1], [1]])
    with pytest.raises(wayfix.Error, match="list of matrices, expected arrays with one axis"):
        pl.DataFrame(Table(p=smoothed))
    assert len(pl.DataFrame(Table(p=[s.probabilities[:, 1] for s in smoothed]))) == 2


def test_times_and_names_of_roads(matcher, frame):
    """The pandas example of the README."""
    _, edges = town()
    edges = pd.DataFrame(edges).assign(name=lambda edges: "street " + edges["from"].astype(str))
    frame = matcher.match_trips(frame, "id").points()
    times = frame.groupby(["id", (frame["edge"] != frame["edge"].shift()).cumsum(), "edge"])["time"].agg(["min", "max"])
    assert (times["max"].to_numpy()[:-1] < times["min"].to_numpy()[1:]).all()
    names = pd.concat([edges, edges.rename(columns={"from": "to", "to": "from"})]).drop_duplicates(["from", "to"])
    named = frame.merge(names[["from", "to", "name"]], on=["from", "to"], how="left")
    assert len(named) == len(frame) and named["name"].notna().all()
