"""Networks from OpenStreetMap, and networks and matchers that are pickled."""

import copy
import pickle

import numpy as np
import pytest
import wayfix
from extract import extract
from wayfix.matching import Matcher, RoadNetwork

NODES = [(1, 50.0, 10.0), (2, 50.0, 10.002), (3, 50.0005, 10.003), (4, 50.0, 10.004), (5, 50.001, 10.002),
         (6, 49.999, 10.002), (7, 50.0, 10.006)]
WAYS = [
    (11, [1, 2], {"highway": "residential", "maxspeed": "30"}),
    (12, [2, 3, 4], {"highway": "secondary", "oneway": "yes"}),  # bends at node 3
    (13, [5, 2, 6], {"highway": "primary"}),
    (14, [4, 7], {"highway": "service"}),
    (15, [5, 7], {"highway": "footway"}),
    (16, [6, 7], {"highway": "residential", "junction": "roundabout"}),
]
NO_LEFT_TURN = ({"type": "restriction", "restriction": "no_left_turn"}, [("from", 1, 11), ("via", 0, 2), ("to", 1, 12)])


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "town.osm.pbf"
    path.write_bytes(extract(NODES, WAYS, [NO_LEFT_TURN]))
    return path


@pytest.fixture
def network(path):
    return RoadNetwork.from_path(path)


def test_openstreetmap(path, network):
    assert network.nodes["node"].tolist() == [1, 2, 4, 5, 6, 7]  # node 3 is a point of a line
    edges = network.edges
    ends = list(zip(edges["from"].tolist(), edges["to"].tolist(), strict=True))
    assert ends == [(1, 2), (2, 1), (2, 4), (2, 5), (2, 6), (4, 7), (5, 2), (6, 2), (6, 7), (7, 4)]
    of = dict(zip(ends, range(len(ends)), strict=True))
    assert edges["class"][of[2, 4]] == "arterial" and edges["class"][of[5, 2]] == "main"
    assert edges["speed_kmh"][of[1, 2]] == pytest.approx(30) and np.isnan(edges["speed_kmh"][of[2, 4]])
    assert edges["reverse"][of[2, 4]] == -1 and edges["reverse"][of[2, 6]] == of[6, 2]
    assert edges["roundabout"].tolist() == [end == (6, 7) for end in ends]
    np.testing.assert_allclose(network.shape(of[2, 4]), [node[1:] for node in NODES[1:4]], atol=1e-7)
    assert "1 forbidden turn" in network.report
    without = RoadNetwork.from_path(str(path), service_roads=False)
    assert without.edge_between(4, 7) is None and network.edge_between(4, 7) == of[4, 7]


def test_damaged_extracts(path):
    whole = path.read_bytes()
    for data in (whole[:-7], whole[:40], b"", b"\0" * 64, whole.replace(b"OSMData", b"OSMDatb")):
        path.write_bytes(data)
        with pytest.raises(wayfix.Error):
            RoadNetwork.from_path(path)


def points():
    return {"time": [0.0, 10.0, 20.0], "lat": [50.00002, 50.0003, 50.00004], "lon": [10.0005, 10.0026, 10.005]}


def test_pickles_and_copies(network):
    for again in (pickle.loads(pickle.dumps(network)), copy.copy(network), copy.deepcopy(network)):
        # The forbidden turn is part of the pickle.
        assert pickle.dumps(again) == pickle.dumps(network) and again.report == network.report
        for name, column in (network.edges | network.nodes).items():
            np.testing.assert_array_equal((again.edges | again.nodes)[name], column)
        for edge in range(len(network.edges["from"])):
            np.testing.assert_array_equal(again.shape(edge), network.shape(edge))

    matcher = Matcher(network, noise=7.1, outliers=0.01)
    for again in (pickle.loads(pickle.dumps(matcher)), copy.copy(matcher), copy.deepcopy(matcher)):
        assert again.model == matcher.model
        found, expected = (m.match_drive(points()) for m in (again, matcher))
        assert found.log_likelihood == expected.log_likelihood
        np.testing.assert_array_equal(found.smoothed().probability, expected.smoothed().probability)
    # A network that two share stays one.
    pair = pickle.loads(pickle.dumps((matcher, network)))
    assert pickle.dumps(pair[0].network) == pickle.dumps(pair[1])


@pytest.mark.parametrize("change", [
    (b'"pairs":[[0,1]', b'"pairs":[[0,9]'), (b'"forbidden":[[', b'"forbidden":[[99,0],['), (b'"main"', b'"mean"'),
    (b'"nodes":[[1,', b'"nodes":[[2,'), (b'"edges":[[1,', b'"edges":[[9,'), (b"{", b""),
])
def test_damaged_pickles(network, change):
    made, (stored, report) = network.__reduce__()
    assert change[0] in stored
    with pytest.raises(wayfix.Error, match="a stored network"):
        made(stored.replace(*change, 1), report)
