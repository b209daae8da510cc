"""Errors say what is wrong in Python's words, and where: the step from 1, the sequence from 0."""

import re

import numpy as np
import pytest
import wayfix
from wayfix.learning import Family, learn
from wayfix.matching import Matcher, RoadNetwork
from wayfix.recognition import Recognizer

MOVES, TABLE = [[0.9, 0.1], [0.2, 0.8]], [[0.8, 0.2], [0.1, 0.9]]


def table():
    return wayfix.Hmm([0.5, 0.5], MOVES, table=TABLE)


def vectors(**named):
    return wayfix.Hmm([0.5, 0.5], MOVES, **named)


def roads():
    nodes = {"node": [1, 2], "lat": [50.0, 50.0], "lon": [10.0, 10.01]}
    return Matcher(RoadNetwork(nodes, {"from": [1], "to": [2], "oneway": ["no"]}))


POISSON = Family("poisson", rates=[[2.0], [9.0]])
NAN = [[1.0, 1.0], [np.nan, 1.0]]
EYE = np.eye(4, dtype=np.float32)
BAD = np.array([EYE[0], EYE[1] * np.nan])
TRIPS = {"id": ["a", "b", "b"], "time": [0, 0, 1], "lat": [50.0, 50.0, 91.0], "lon": [10.001] * 3}


@pytest.mark.parametrize("call, sequence, step", [
    (lambda: table().score([0, -1]), 0, 2),
    (lambda: table().score([0, 0, 7]), 0, 3),
    (lambda: table().score_all([[0], [0, -1]]), 1, 2),
    (lambda: table().score_all([0, 0, 1, -1], [2, 2]), 1, 2),
    (lambda: table().score_all([[0], [0.5]]), 1, None),
    (lambda: table().filter().step(-1), 0, 1),
    (lambda: vectors().score(NAN), 0, 2),
    (lambda: vectors().score_all([[[1.0, 1.0]], NAN]), 1, 2),
    (lambda: vectors().score_all([[[1.0, 1.0]], [[1.0]]], ), None, None),
    (lambda: learn(table(), [[0, 1], [0, -1]]), 1, 2),
    (lambda: learn(table(), [[0, 1], [0, 1, 9]]), 1, 3),
    (lambda: learn(table(), [[9]]), 0, 1),
    (lambda: learn(vectors(logarithms=True), [[[2.0]], [[1.0], [np.nan]]], POISSON), 1, 2),
    (lambda: learn(vectors(logarithms=True), [[[2.0]], [[1.0], [-3.0]]], POISSON, iterations=0), 1, 2),
    (lambda: POISSON.log_likelihoods([[1.0], [-1.0]]), 0, 2),
    (lambda: Recognizer(EYE).recording(BAD), 0, 2),
    (lambda: Recognizer(EYE).track().step(BAD[1]), 0, 1),
    (lambda: Recognizer(EYE).fit(np.concatenate([EYE, BAD]), [0, 1, 2, 3, 0, 1], lengths=[4, 2]), 1, 2),
    (lambda: Recognizer(EYE).fit(np.concatenate([EYE, EYE]), [0, 1, 2, 3, 0, 9, 1, 2], lengths=[4, 4]), 1, 2),
    (lambda: roads().match_drive({"time": [0, 0], "lat": [50.0, 50.0], "lon": [10.001, 10.002]}), 0, 2),
    (lambda: roads().start(0, 50.0, np.nan), 0, 1),
    (lambda: roads().start(0, 50.0, 10.001).step(0, 50.0, 10.001), 0, 2),
    (lambda: roads().match_trips(TRIPS, "id"), 1, 2),
])
def test_where(call, sequence, step):
    with pytest.raises(wayfix.Error) as raised:
        call()
    assert (raised.value.sequence, raised.value.step) == (sequence, step), raised.value


def test_a_sequence_that_is_ruled_out_is_left_out():
    hmm = wayfix.Hmm([1.0, 0.0], [[1.0, 0.0], [0.0, 1.0]], table=[[1.0, 0.0], [0.0, 1.0]])
    learned = learn(hmm, [[0, 0], [0, 1]])
    assert [number for number, _ in learned.left_out] == [1]
    with pytest.raises(wayfix.ImpossibleError) as raised:
        learn(hmm, [[0, 1]])
    assert (raised.value.sequence, raised.value.step) == (0, 2)


def test_rows_of_moves():
    with pytest.raises(wayfix.Error, match=r"row 0 of moves .* sums to 1\.1.* columns sum to one: transpose"):
        wayfix.Hmm([0.5, 0.5], [[0.9, 0.2], [0.1, 0.8]])
    for moves in ([[0.5, 0.5], [0.3, 0.3]], ([0, 0, 1], [0, 1, 1], [0.5, 0.5, 0.6])):
        with pytest.raises(wayfix.Error, match=r"row 1 of moves \(those from state 1\) sums to 0\.6") as raised:
            wayfix.Hmm([0.5, 0.5], moves)
        assert "column" not in str(raised.value)


RUST = re.compile(r"struct |usize|u64|f64|Named\(|sensor failed|Options::|with_missing|null|floating point|0 axes")


@pytest.mark.parametrize("call", [
    lambda: Recognizer(EYE, speeds="fast"),
    lambda: Recognizer(EYE, window=-1),
    lambda: Recognizer(EYE, window="a"),
    lambda: Recognizer(EYE, odds={"shares": None}),
    lambda: RoadNetwork({"node": [1], "lat": [0], "lon": [0]}, {"from": [], "to": []}, cleaning=["contract"]),
    lambda: POISSON.log_likelihoods([[np.nan]]),
    lambda: Family("gaussian", covariance_type="full", means=[[0.0]], covariances=[[[1.0]]]).log_likelihoods([[np.nan]]),
    lambda: Family("poisson", rates=2.0),
    lambda: table().score(3),
    lambda: table().k_best([0, 1], -1),
    lambda: table().score_all([[0]], n_jobs=0),
])
def test_words(call):
    with pytest.raises(wayfix.Error) as raised:
        call()
    assert not RUST.search(str(raised.value)), raised.value


def test_threads():
    sequences = [[0, 1, 1]] * 9
    expected = table().score_all(sequences)
    for n_jobs in (-1, -2, 1, 2, 10_000):
        np.testing.assert_array_equal(table().score_all(sequences, n_jobs=n_jobs), expected)


def test_speeds_in_part():
    options = Recognizer(EYE, speeds={"values": [0, 1, 2]}).options["speeds"]
    assert options == Recognizer(EYE, speeds=[0, 1, 2]).options["speeds"]
    slower = Recognizer(EYE, speeds={"slack": 0.1}).options["speeds"]
    assert slower["slack"] == 0.1 and slower["shares"] == Recognizer(EYE).options["speeds"]["shares"]
    given = {"values": [0, 1], "shares": [0.25, 0.75]}
    assert Recognizer(EYE, speeds=given).options["speeds"]["shares"] == [0.25, 0.75]
