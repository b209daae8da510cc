"""Roads and GPS points in a simulated town, checked by geometry in numpy; frames of all types."""

import copy
import csv
import json
import pickle

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
import wayfix
from wayfix.matching import Matcher, RoadNetwork, read_traces

RADIUS = 6_371_008.8
DEGREE = np.pi / 180 * RADIUS
SIDE, BLOCK = 6, 150.0
LAT, LON = 50.0, 10.0


def to_degrees(xy):
    """Latitudes and longitudes of metres to the east and north."""
    xy = np.asarray(xy, float)
    return LAT + xy[..., 1] / DEGREE, LON + xy[..., 0] / (DEGREE * np.cos(np.radians(LAT)))


def town():
    """A grid of two-way streets; node 10 row + column."""
    rows, columns = np.divmod(np.arange(SIDE * SIDE), SIDE)
    ids = 10 * rows + columns
    lat, lon = to_degrees(np.stack([BLOCK * columns, BLOCK * rows], axis=1))
    ends = [(a, b) for a in ids for b in (a + 1, a + 10) if b in ids]
    nodes = {"node": ids, "lat": lat, "lon": lon}
    return nodes, {"from": [a for a, _ in ends], "to": [b for _, b in ends], "oneway": ["no"] * len(ends)}


def drive(seed, network, every=2.0, metres=900.0):
    """Points of a vehicle at 10 m/s without U-turns, with an offset that lasts; the true edges, and the
    metres along them."""
    rng = np.random.default_rng(seed)
    at = [rng.integers(1, SIDE - 1, 2)]
    steps = [np.array(step) for step in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    last = None
    while len(at) * BLOCK < metres + 2 * BLOCK:
        step = steps[rng.integers(4)]
        ahead = at[-1] + step
        if (last is None or (step != -last).any()) and ((0 <= ahead) & (ahead < SIDE)).all():
            at.append(ahead)
            last = step
    at = np.array(at)
    along = np.arange(0, metres, 10 * every)
    block, rest = np.divmod(along, BLOCK)
    block = block.astype(int)
    xy = BLOCK * at[block] + rest[:, None] * (at[block + 1] - at[block])
    xy = xy + rng.normal(scale=3, size=2) + rng.normal(scale=0.2, size=xy.shape)
    ids = 10 * at[:, 1] + at[:, 0]
    edges = [network.edge_between(int(ids[k]), int(ids[k + 1])) for k in block]
    lat, lon = to_degrees(xy)
    return {"time": every * np.arange(len(lat)), "lat": lat, "lon": lon}, np.array(edges), rest


@pytest.fixture(scope="module")
def matcher():
    return Matcher(RoadNetwork(*town()))


def test_network(tmp_path, matcher):
    network = matcher.network
    edges, nodes = network.edges, network.nodes
    assert len(edges["from"]) == 2 * 2 * SIDE * (SIDE - 1)
    place = dict(zip(nodes["node"].tolist(), zip(nodes["lat"], nodes["lon"], strict=True), strict=True))
    for edge in (0, 17, 80):
        (a, b), (c, d) = (np.radians(place[edges[end][edge]]) for end in ("from", "to"))
        haversine = np.sin((c - a) / 2) ** 2 + np.cos(a) * np.cos(c) * np.sin((d - b) / 2) ** 2
        assert edges["length_m"][edge] == pytest.approx(2 * RADIUS * np.arcsin(np.sqrt(haversine)))
        back = edges["reverse"][edge]
        assert (edges["from"][back], edges["to"][back]) == (edges["to"][edge], edges["from"][edge])
        np.testing.assert_allclose(network.shape(edge), [place[edges[end][edge]] for end in ("from", "to")])
    # The same network from its own columns, from files, and from frames of all types.
    again = RoadNetwork(nodes, edges)
    np.testing.assert_array_equal(again.edges["length_m"], edges["length_m"])
    assert again.report == network.report and "not known" not in again.report
    for name, columns in zip(("nodes", "edges"), town(), strict=True):
        pd.DataFrame(columns).to_csv(tmp_path / f"{name}.csv", index=False)
    (tmp_path / "roads.geojson").write_text(network.to_geojson())
    made = [
        RoadNetwork.from_path(tmp_path),
        RoadNetwork.from_path(str(tmp_path / "roads.geojson")),
        RoadNetwork.from_geojson(network.to_geojson()),
        RoadNetwork.from_geojson(network.to_geojson().encode()),
        RoadNetwork.from_geojson(type("Frame", (), {"__geo_interface__": json.loads(network.to_geojson())})()),
        *[RoadNetwork(*map(kind, town())) for kind in (pd.DataFrame, pl.DataFrame, pa.table)],
    ]
    for other in made:
        assert repr(other) == repr(network)
        np.testing.assert_allclose(np.sort(other.edges["length_m"]), np.sort(edges["length_m"]), rtol=1e-6)


def test_columns_of_a_network():
    nodes = {"id": [1.0, 2.0, 3.0], "latitude": [0, 0, 0], "longitude": [0, 0.01, 0.02], "name": ["a", "b,\"", None]}
    edges = pd.DataFrame({"from": [1, 2], "to": [2, 3], "class": ["main", 0], "oneway": [True, False],
                          "speed_kmh": [60, np.nan], "lanes": [2, 1], "length_m": [None, 1200]})
    network = RoadNetwork(nodes, edges, cleaning=["largest_component"])
    assert "lanes in edges" in network.report and "largest part" in network.report
    network = RoadNetwork(nodes, edges)
    found = network.edges
    assert found["class"].tolist() == ["main", "street", "street"]
    np.testing.assert_allclose(found["speed_kmh"], [60, np.nan, np.nan])
    assert found["length_m"][1] == 1200 and network.edge_between(2, 1) is None
    assert network.edge_between(3, 2) == 2 and network.edge_between(9, 2) is None
    one_way = {"from": [1, 2], "to": [2, 3]}
    contracted = RoadNetwork(nodes, one_way, cleaning=["contraction", ("within", (-1, -1), (1, 1))])
    assert repr(contracted) == "<RoadNetwork: 2 nodes, 1 edges>"


@pytest.mark.parametrize("seed", range(6))
def test_a_drive(matcher, seed):
    points, truth, rest = drive(seed, matcher.network)
    found = matcher.match_drive(points)
    roads = found.smoothed()
    inside = (rest > 15) & (rest < BLOCK - 15)
    assert (roads.edge == truth)[inside].mean() > 0.95
    assert roads.probability[inside & (roads.edge == truth)].mean() > 0.8
    # If the road is right, the answer is the projection of the position, up to the noise along the road.
    right = inside & (roads.edge == truth)
    assert np.abs(roads.metres_along - rest)[right].max() < 15
    lat, lon = roads.positions.T
    off = np.hypot((lat - points["lat"]) * DEGREE, (lon - points["lon"]) * DEGREE * np.cos(np.radians(LAT)))
    assert off[right].max() < 15
    # The probabilities of a point sum to one, and their entropy is that of the answer.
    for k in range(0, len(found), 7):
        edges, p = found.edges(k)
        every = np.append(p, roads.off_road[k])
        assert every.sum() == pytest.approx(1)
        entropy = -np.sum(np.where(every > 0, every * np.log(np.where(every > 0, every, 1)), 0))
        assert roads.entropy[k] == pytest.approx(entropy, abs=1e-12)
        assert edges[0] == roads.edge[k] and p[0] == roads.probability[k]
        inner = found.credible(k, 0.9)
        assert inner.probability >= 0.9 and (inner.exit > inner.enter).all()
    assert found.log_likelihood == pytest.approx(found.log_normalizers.sum())
    # The route is connected, is as long as the drive, and comes first among several.
    route, edges = found.route, matcher.network.edges
    assert (edges["to"][route.edge[:-1]] == edges["from"][route.edge[1:]]).all()
    assert route.metres == pytest.approx(880, abs=40) == found.metres
    line = np.diff(route.line(), axis=0) * [DEGREE, DEGREE * np.cos(np.radians(LAT))]
    assert np.hypot(*line.T).sum() == pytest.approx(route.metres, rel=1e-4)
    ranked = found.routes(3)
    probabilities = [other.probability for other in ranked.routes]
    assert ranked.is_exact and probabilities == sorted(probabilities, reverse=True)
    assert sum(probabilities) + ranked.remaining == pytest.approx(1)
    assert len(json.loads(route.to_geojson())["features"]) == len(route)

    # Live, point by point.
    vehicle = matcher.start(*(points[name][0] for name in ("time", "lat", "lon")), lag=3)
    live, late = found.live(), found.late(3)
    for k in range(1, len(found)):
        log = vehicle.step(*(points[name][k] for name in ("time", "lat", "lon")))
        assert log == pytest.approx(found.log_normalizers[k])
        assert vehicle.live.edge == (None if live.edge[k] < 0 else live.edge[k])
        assert vehicle.live.probability == pytest.approx(live.probability[k])
        if k >= 3:
            assert vehicle.late.probability == pytest.approx(late.probability[k - 3])
            assert vehicle.ago(3) == vehicle.late and vehicle.ago(4) is None
        if k == len(found) // 2:
            others = [copy.copy(vehicle), pickle.loads(pickle.dumps(vehicle)), matcher.vehicle_from_bytes(vehicle.to_bytes())]
    for k in range(len(found) // 2 + 1, len(found)):
        for other in others:
            other.step(*(points[name][k] for name in ("time", "lat", "lon")))
    assert all(other.live == vehicle.live for other in others)
    assert all(other.to_bytes() == vehicle.to_bytes() for other in others)
    assert vehicle.log_likelihood == pytest.approx(found.log_likelihood)
    assert vehicle.live.probability == roads.probability[-1]


def frame_of(network, seeds, rng):
    """Trips in one frame, their rows shuffled."""
    parts = []
    for seed in seeds:
        points, truth, rest = drive(seed, network)
        parts.append(pd.DataFrame(points).assign(vehicle=f"car {seed % 7}-{seed}", truth=truth, rest=rest))
    frame = pd.concat(parts).sample(frac=1, random_state=rng)
    frame["time"] = pd.Timestamp("2024-05-01", tz="Europe/Berlin") + pd.to_timedelta(frame["time"], "s")
    return frame


@pytest.mark.parametrize("kind", [
    lambda frame: frame,
    pl.from_pandas,
    lambda frame: pa.Table.from_pandas(frame, preserve_index=False),
    lambda frame: {name: frame[name].to_numpy() for name in frame if name != "time"}
    | {"time": frame["time"].dt.tz_convert("UTC").dt.tz_localize(None).to_numpy()},
])
def test_trips_of_a_frame(matcher, kind):
    pandas = frame_of(matcher.network, range(9), 0)
    frame = kind(pandas)
    matched = matcher.match_trips(frame, "vehicle")
    points = matched.points()
    assert type(points) is type(frame) and type(matched.routes()) is type(frame)

    def column(of, name):
        return np.asarray(of[name])

    inside = (pandas["rest"].to_numpy() > 15) & (pandas["rest"].to_numpy() < BLOCK - 15)
    assert (column(points, "edge") == pandas["truth"].to_numpy())[inside].mean() > 0.95
    edges = matcher.network.edges
    np.testing.assert_array_equal(column(points, "from"), edges["from"][column(points, "edge")])
    assert len(matched) == 9 and matched.skipped == 0 and not matched.failed
    np.testing.assert_array_equal(column(points, "lat"), pandas["lat"].to_numpy())
    # The same as one by one, sorted by hand.
    routes = {name: column(matched.routes(), name) for name in ("vehicle", "seq", "edge", "enter_m", "exit_m")}
    assert list(dict.fromkeys(routes["vehicle"])) == list(dict.fromkeys(pandas["vehicle"]))
    for name, trip in pandas.reset_index(drop=True).groupby("vehicle"):
        trip = trip.sort_values("time")
        one = matcher.match_drive(trip)
        np.testing.assert_allclose(matched.probability[trip.index], one.smoothed().probability)
        np.testing.assert_allclose(matched.log_normalizers[trip.index], one.log_normalizers)
        assert matched.log_likelihoods[name] == pytest.approx(one.log_likelihood)
        of = routes["vehicle"] == name
        np.testing.assert_array_equal(routes["edge"][of], one.route.edge)
        np.testing.assert_allclose(routes["exit_m"][of], one.route.exit)
        assert routes["seq"][of].tolist() == list(range(len(one.route)))
    for estimator, answers in [("live", lambda one: one.live()), ("late", lambda one: one.late(2))]:
        other = matcher.match_trips(frame, "vehicle", estimator=estimator, lag=2)
        np.testing.assert_allclose(other.probability[trip.index], answers(one).probability)


def test_rows_of_equal_times_and_trips_that_fail(matcher):
    points, _, _ = drive(0, matcher.network)
    frame = pd.DataFrame(points).assign(id=1)
    twice = pd.concat([frame, frame.assign(lat=0.0), frame.assign(id="other")], ignore_index=True)
    matched = matcher.match_trips(twice.astype({"id": object}), "id")
    n = len(frame)
    assert matched.skipped == n and (matched.edge[n:2 * n] == -1).all()
    assert np.isnan(matched.probability[n:2 * n]).all() and len(matched) == 2
    np.testing.assert_array_equal(matched.probability[:n], matched.probability[2 * n:])
    bad = pd.concat([frame, frame.assign(id=2)], ignore_index=True)
    bad.loc[n + 5, "lat"] = 99
    with pytest.raises(wayfix.Error, match=rf"trip .*2.*: point 5 has latitude 99.*row {n + 5}") as raised:
        matcher.match_trips(bad, "id")
    assert (raised.value.sequence, raised.value.step) == (1, 6)
    matched = matcher.match_trips(bad, "id", errors="skip")
    assert list(matched.failed) == [2] and np.isnan(matched.log_likelihoods[2])
    assert np.isfinite(matched.probability[:n]).all() and (matched.edge[n:] == -1).all()
    assert len(matched.routes()["id"]) == len(matcher.match_drive(points).route)
    empty = matcher.match_trips(frame[:0], "id")
    assert len(empty) == 0 and len(empty.points()) == 0


def test_columns_with_nulls_and_zones(matcher):
    points, _, _ = drive(2, matcher.network)
    frame = pd.DataFrame(points).assign(accuracy=5.0, speed=10)
    frame.loc[3, "accuracy"] = np.nan
    expected = matcher.match_drive(frame).smoothed().probability
    when = pd.Timestamp("2024-05-01", tz="America/New_York") + pd.to_timedelta(frame["time"], "s")
    kinds = {
        "nullable": {"accuracy": frame["accuracy"].astype("Float64"), "speed": frame["speed"].astype("Int64")},
        "arrow": {"accuracy": frame["accuracy"].astype("float64[pyarrow]").replace(np.nan, None), "lat": frame["lat"].astype("float64[pyarrow]")},
        "zone": {"time": when},
        "arrow zone": {"time": when.astype(pd.ArrowDtype(pa.timestamp("us", "America/New_York")))},
        "arrow dates": {"time": when.dt.tz_localize(None).astype(pd.ArrowDtype(pa.timestamp("ms")))},
    }
    for name, columns in kinds.items():
        found = matcher.match_drive(frame.assign(**columns)).smoothed().probability
        np.testing.assert_allclose(found, expected, atol=1e-6, err_msg=name)


def test_learning(matcher):
    rng = np.random.default_rng(0)
    frames = frame_of(matcher.network, range(12), 1)
    # Twelve metres of independent noise.
    frames["lat"] += rng.normal(scale=12 / DEGREE, size=len(frames))
    frames["lon"] += rng.normal(scale=12 / DEGREE / np.cos(np.radians(LAT)), size=len(frames))
    learned = matcher.learn(frames, "vehicle", iterations=8)
    assert learned.points == len(frames) and learned.held_out > 7
    assert 8 < learned.model["noise"] < 16 and learned.model["lasting"] < 0.9
    better = matcher.with_model(**learned.model)
    assert better.model == learned.model

    def total(matcher):
        return sum(matcher.match_trips(frames, "vehicle").log_likelihoods.values())

    assert total(better) > total(matcher) + 7
    assert learned.median_interval == 2.0


def test_traces_from_a_file(tmp_path, matcher):
    points, _, _ = drive(3, matcher.network)
    with open(tmp_path / "drives.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["trace", "time", "longitude", "latitude", "heading", "odd"])
        rows = zip(points["time"], points["lon"], points["lat"], strict=True)
        writer.writerows(["A", *row, "", 1] for row in rows)
        writer.writerow(["A", 0, 10, 50, "", 1])
    columns, report = read_traces(tmp_path / "drives.csv")
    np.testing.assert_array_equal(columns["lat"], points["lat"])
    assert np.isnan(columns["heading"]).all() and "unknown column: odd" in report
    assert "1 that go back in time" in report
    matched = matcher.match_trips(columns, "trip")
    np.testing.assert_allclose(matched.probability, matcher.match_drive(points).smoothed().probability)
    with pytest.raises(wayfix.Error, match="missing.gpx"):
        read_traces(tmp_path / "missing.gpx")


ONE = {"time": [0.0, 1.0], "lat": [LAT, LAT], "lon": [LON, LON]}


@pytest.mark.parametrize(("call", "message"), [
    (lambda m: m.match_drive({}), "no column time or timestamp"),
    (lambda m: m.match_drive(3), "a frame is a int"),
    (lambda m: m.match_drive(ONE | {"lat": [LAT]}), "found 1 latitudes, expected 2"),
    (lambda m: m.match_drive(ONE | {"lat": [[LAT, LAT]]}), "has 2 axes"),
    (lambda m: m.match_drive(ONE | {"lat": ["a", "b"]}), "latitudes have type"),
    (lambda m: m.match_drive(ONE | {"lat": [[1], [1, 2]]}), "column 'lat' cannot be read"),
    (lambda m: m.match_drive(ONE | {"lat": [LAT, np.nan]}), "point 1 has latitude NaN"),
    (lambda m: m.match_drive(ONE | {"lat": [LON, 100.0], "lon": [LAT, LAT]}), "swapped"),
    (lambda m: m.match_drive(ONE | {"time": [1, 0]}), "point 1 has time 0"),
    (lambda m: m.match_drive(ONE | {"time": ["a", "b"]}), "the time is 'a', expected"),
    (lambda m: m.match_drive(ONE | {"time": np.array(["NaT", "2024"], "M8[s]")}), "point 0 has time NaN"),
    (lambda m: m.match_drive(ONE | {"accuracy": [1, -1]}), "point 1 has accuracy -1"),
    (lambda m: m.match_drive({name: [] for name in ONE}), "no points"),
    (lambda m: m.match_trips(ONE, "id"), "no column 'id'"),
    (lambda m: m.match_trips(ONE | {"id": [1]}, "id"), "1 rows, expected 2"),
    (lambda m: m.match_trips(ONE, estimator="best"), "the estimator is"),
    (lambda m: m.match_trips(ONE, errors="ignore"), "expected 'raise' or 'skip'"),
    (lambda m: m.match_trips(ONE, lag=-1), "-1"),
    (lambda m: m.match_drive(ONE).edges(2), "no point 2"),
    (lambda m: m.match_drive(ONE).credible(0, 1.5), "mass is 1.5"),
    (lambda m: m.start(0, 100, 0), "latitude 100"),
    (lambda m: m.start(0, LAT, LON).step(0, LAT, LON), "time 0"),
    (lambda m: m.vehicle_from_bytes(b"abc"), "state of a vehicle: expected value"),
    (lambda m: Matcher(RoadNetwork(NODES, {"from": [1], "to": [2]})).vehicle_from_bytes(
        m.start(0, LAT, LON).to_bytes()), "from another network"),
    (lambda m: m.with_model(noise=-1), "noise is -1"),
    (lambda m: m.with_model(nois=1), "unknown field `nois`"),
    (lambda m: m.learn(ONE | {"lat": [LAT, 100.0]}), "drive 0.*latitude 100"),
    (lambda m: m.network.shape(10**6), "no edge 1000000"),
    (lambda m: m.network.edge_between(-1, 0), "-1 is not a valid count"),
    (lambda m: RoadNetwork(NODES, {"from": [1], "to": [9]}), "row 0 of edges.*place 9"),
    (lambda m: RoadNetwork(NODES, {"from": [1]}), "no column to"),
    (lambda m: RoadNetwork(NODES, {"from": [1, 2], "to": [2]}), "'to' has 1 rows, expected 2"),
    (lambda m: RoadNetwork(NODES | {"lat": [91, 0]}, {"from": [1], "to": [2]}), "row 0 of nodes"),
    (lambda m: RoadNetwork(NODES, {"from": [1], "to": [2], "oneway": ["perhaps"]}), "row 0 of edges"),
    (lambda m: RoadNetwork(NODES, {"from": [1], "to": [2]}, cleaning=["polish"]), "expected 'largest_component'"),
    (lambda m: RoadNetwork({name: [] for name in NODES}, {"from": [], "to": []}), "at least one place, found none"),
    (lambda m: RoadNetwork.from_geojson("{"), "features, line 1"),
    (lambda m: RoadNetwork.from_geojson(3), "expected GeoJSON"),
    (lambda m: RoadNetwork.from_path("/nowhere/city.osm.pbf"), "city.osm.pbf"),
])
def test_hostile_input(matcher, call, message):
    with pytest.raises(wayfix.Error, match=message):
        call(matcher)


NODES = {"node": [1, 2], "lat": [0.0, 0.01], "lon": [0.0, 0.0]}


@pytest.mark.parametrize("change", [
    lambda a: np.ascontiguousarray(a[::-1])[::-1],
    lambda a: a.astype(np.float32).astype(float),
    lambda a: a.tolist(),
    lambda a: np.repeat(a, 2)[::2],
])
def test_any_layout(matcher, change):
    points, _, _ = drive(5, matcher.network)
    points = {name: values.astype(np.float32).astype(float) for name, values in points.items()}
    for values in points.values():
        values.setflags(write=False)
    expected = matcher.match_drive(points).smoothed().probability
    found = matcher.match_drive({name: change(values) for name, values in points.items()})
    np.testing.assert_array_equal(found.smoothed().probability, expected)


@pytest.mark.parametrize("call", ["match_trips", "match_drive", "learn"])
def test_interrupt(matcher, call, interrupted):
    points = pd.DataFrame(drive(0, matcher.network, every=1.0)[0])
    copies, each = np.repeat(np.arange(3000), len(points)), np.tile(np.arange(len(points)), 3000)
    many = points.iloc[each].assign(id=copies)
    long = many.assign(time=many["time"] + 200 * copies)
    interrupted({
        "match_trips": lambda: matcher.match_trips(many, "id"),
        "match_drive": lambda: matcher.match_drive(long),
        "learn": lambda: matcher.learn(many, "id"),
    }[call], goes_on=call != "match_trips")
