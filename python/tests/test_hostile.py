"""Invalid arrays, exhausted memory, and signals."""

import copy
import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import scipy.sparse
import wayfix

MOVES = [[0.9, 0.1], [0.2, 0.8]]


def vectors():
    return wayfix.Hmm([0.5, 0.5], MOVES)


def table():
    return wayfix.Hmm([0.5, 0.5], MOVES, table=[[0.8, 0.2], [0.1, 0.9]])


def test_masked_values_anywhere():
    row = np.ma.masked_array([0.5, 0.5], mask=[0, 1])
    with pytest.raises(wayfix.Error, match="masked"):
        vectors().filter().step(row)
    for ys in [[[0.5, 0.5], row], [row]]:
        with pytest.raises(wayfix.Error, match="masked"):
            vectors().score(ys)
    with pytest.raises(wayfix.Error, match="masked"):
        table().score([0, np.ma.masked])
    shown = np.ma.masked_array([0.5, 0.5], mask=[0, 0])
    assert np.isfinite(vectors().filter().step(shown))


@pytest.mark.parametrize("symbol", [-1, 2**70, 0.5, "a", None, 2, [0]])
def test_a_symbol_that_does_not_exist(symbol):
    live = table().filter()
    with pytest.raises(wayfix.Error):
        live.step(symbol)
    assert live.steps == 0


def test_arrays_out_of_line_are_converted():
    rows = np.random.default_rng(0).random((20, 2))
    bytes_ = np.zeros(rows.nbytes + 1, dtype=np.uint8)
    unaligned = bytes_[1:].view(np.float64).reshape(20, 2)
    unaligned[:] = rows
    swapped = rows.astype(rows.dtype.newbyteorder())
    expected = vectors().smooth(rows).probabilities
    for ys in [unaligned, swapped]:
        assert (vectors().smooth(ys).probabilities == expected).all()
        assert vectors().filter().step(ys[0]) == vectors().filter().step(rows[0])


def test_entries_that_come_twice_add_up():
    rows, columns, values = [0, 0, 0, 1, 1], [0, 0, 1, 0, 1], [0.4, 0.5, 0.1, 0.2, 0.8]
    moves = scipy.sparse.coo_array((values, (rows, columns)), shape=(2, 2))
    ys = np.random.default_rng(1).random((20, 2))
    assert wayfix.Hmm([0.5, 0.5], moves).score(ys) == pytest.approx(vectors().score(ys), rel=1e-14)
    assert moves.nnz == 5


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_protocol(protocol):
    hmm = table()
    ys = [0, 1, 1]
    smoothed, path, live = hmm.smooth(ys), hmm.viterbi(ys), hmm.filter()
    live.step(1)
    hmm2, smoothed2, path2, live2 = pickle.loads(pickle.dumps((hmm, smoothed, path, live), protocol))
    assert hmm2.score(ys) == hmm.score(ys)
    assert (smoothed2.probabilities == smoothed.probabilities).all()
    assert smoothed2.log_likelihood == smoothed.log_likelihood
    assert (path2.states == path.states).all() and path2.log_probability == path.log_probability
    assert live2.step(0) == live.step(0)
    assert (copy.deepcopy(path).states == path.states).all()


def test_every_error_says_where():
    with pytest.raises(wayfix.Error) as raised:
        vectors().smooth_all([[[1.0, 1.0]], [[1.0, 1.0], [-1.0, 1.0]]])
    assert not isinstance(raised.value, wayfix.ImpossibleError)
    assert (raised.value.sequence, raised.value.step) == (1, 2)
    assert "sequence 1" in str(raised.value) and "step 2" in str(raised.value)
    with pytest.raises(wayfix.Error) as raised:
        wayfix.Hmm([0.5, 0.6], MOVES)
    assert raised.value.step is raised.value.sequence is None


def test_private_functions_do_not_panic():
    from wayfix import _wayfix

    start, moves, logs = np.full(2, 0.5), np.array(MOVES), np.zeros((3, 2))
    for lengths in [[2**64 - 1, 4], [2**63, 2**63, 3], [2], []]:
        with pytest.raises(wayfix.Error):
            _wayfix.smooth(start, moves, logs, lengths)
    with pytest.raises(wayfix.Error):
        _wayfix.expectations(np.ones(0), np.ones((0, 0)), np.zeros((0, 0)), [0])


def test_more_paths_than_memory():
    ys = np.random.default_rng(2).random((2000, 2))
    with pytest.raises(MemoryError, match="paths"):
        vectors().k_best(ys, 2**60)
    assert len(vectors().k_best(ys[:3], 2**60)) == 8


#: Calls with sizes that nobody means, and how they end.
HUGE = {
    "Recognizer.from_distances(200_000_000)": "MemoryError",
    "Recognizer.from_similarities(200_000_000, off_map=True)": "MemoryError",
    "Recognizer.from_distances(2**32 - 1)": "Error",
    "Recognizer.from_distances(2**63)": "Error",
    "Recognizer.from_distances(2**64)": "Error",
    "Recognizer.from_distances(10**6).with_options(speeds=np.linspace(-60, 60, 1000))": "MemoryError",
    "Recognizer(np.ones((2**20, 1)), speeds=np.linspace(-60, 60, 1000))": "MemoryError",
    "hmm.k_best([0] * 1000, 2**62)": "MemoryError",
    "hmm.score_all([[0]] * 9, n_jobs=2**61)": "array",
    "hmm.score_all([[0]] * 20_000, n_jobs=20_000)": "array",
    "wayfix.FixedLag(hmm, 2**62).step(0)": "float",
    "learn(hmm, [[0, 1]], iterations=2**62, tolerance=1.0)": "Learned",
    "Mapper(gap=2**62).step([1.0])": "None",
    "recording.lagged(2**62)": "PlaceBeliefs",
    "recording.smoothed().mass_near(np.zeros(9, int), 2**62)": "array",
    "reliability([0.5], [True], 2**62)": "dict",
    "matcher.match_drive(points).routes(2**62)": "RankedRoutes",
    "matcher.match_drive(points).late(2**62)": "RoadAnswers",
    "matcher.start(0, 0, 0, lag=2**62).step(9, 0, 0.001)": "float",
    "matcher.match_trips(points, estimator='late', lag=2**62)": "MatchedTrips",
}
PREPARED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
import numpy as np, wayfix
from wayfix.evaluate import reliability
from wayfix.learning import learn
from wayfix.matching import Matcher, RoadNetwork
from wayfix.recognition import Mapper, Recognizer
hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.8, 0.2], [0.1, 0.9]])
recording = Recognizer.from_distances(9).recording(np.eye(9))
points = {"time": [0, 10], "lat": [0, 0], "lon": [0.001, 0.002]}
matcher = Matcher(RoadNetwork({"node": [1, 2], "lat": [0, 0], "lon": [0, 0.01]}, {"from": [1], "to": [2], "oneway": ["no"]}))
for line in sys.argv[1:]:
    try:
        print(type(eval(line)).__name__)
    except Exception as error:
        print(type(error).__name__)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is limited as Linux does it")
def test_sizes_that_nobody_means():
    done = subprocess.run([sys.executable, "-c", PREPARED, *HUGE], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    names = {"NoneType": "None", "ndarray": "array"}
    assert dict(zip(HUGE, (names.get(line, line) for line in done.stdout.split()), strict=True)) == HUGE


def long_calls():
    """Calls that take a few seconds each."""
    from wayfix import _wayfix

    rng = np.random.default_rng(3)
    n = 1000
    moves = rng.dirichlet(np.ones(n), n)
    start, ys = np.full(n, 1 / n), rng.random((15_000, n))
    hmm, few = wayfix.Hmm(start, moves), vectors()
    return {
        "one": lambda: hmm.smooth(ys),
        "many": lambda: hmm.smooth_all([ys[:200]] * 300),
        "threads": lambda: hmm.smooth_all([ys[:200]] * 600, n_jobs=2),
        "paths": lambda: few.k_best(rng.random((100_000, 2)), 200),
        "families": lambda: _wayfix.expectations(start, moves, ys, [5000, 10_000]),
    }


class Stopped(Exception):
    """Raised by a signal handler."""


def seconds(call, stop_after):
    begin = time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, stop_after)
    try:
        call()
    except Stopped:
        pass
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return time.monotonic() - begin


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers here")
@pytest.mark.parametrize("name", ["one", "many", "threads", "paths", "families"])
def test_a_signal_ends_what_is_computed(name):
    def stop(*_):
        raise Stopped

    call, before = long_calls()[name], signal.signal(signal.SIGALRM, stop)
    try:
        whole = seconds(call, 0)
        assert seconds(call, whole / 10) < whole / 2
    finally:
        signal.signal(signal.SIGALRM, before)
