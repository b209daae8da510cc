"""`wayfix.Hmm` against the enumeration of all paths, and the arrays that it accepts."""

import copy
import itertools
import pickle

import numpy as np
import pytest
import scipy.sparse
import wayfix


def random_model(rng, zeros=0.3):
    n, symbols = rng.integers(2, 5), rng.integers(2, 4)

    def rows(count, width):
        weights = rng.random((count, width)) * (rng.random((count, width)) > zeros)
        weights[np.arange(count), rng.integers(0, width, count)] += 0.1
        return weights / weights.sum(axis=1, keepdims=True)

    return rows(1, n)[0], rows(n, n), rows(n, symbols)


def enumerate_paths(start, moves, likelihoods, before):
    """All possible paths, sorted by the joint probability of path and observations."""
    steps, n = likelihoods.shape
    found = {}
    for path in itertools.product(range(n), repeat=steps + before):
        p = start[path[0]]
        for a, b in itertools.pairwise(path):
            p *= moves[a, b]
        seen = path[before:]
        p *= np.prod([likelihoods[k, state] for k, state in enumerate(seen)])
        if p > 0:
            found[path] = p
    return found


@pytest.mark.parametrize("seed", range(60))
def test_all_paths(seed):
    rng = np.random.default_rng(seed)
    start, moves, table = random_model(rng)
    before, n = bool(rng.integers(2)), len(start)
    symbols = rng.integers(0, table.shape[1], rng.integers(1, 6))
    likelihoods = np.ascontiguousarray(table.T[symbols])
    paths = enumerate_paths(start, moves, likelihoods, before)
    with np.errstate(divide="ignore"):
        logs = np.log(likelihoods)
    models = [
        (wayfix.Hmm(start, moves, table=table, start_before_move=before), symbols),
        (wayfix.Hmm(start, scipy.sparse.csr_array(moves), table=table, start_before_move=before), symbols),
        (wayfix.Hmm(start, moves, start_before_move=before), likelihoods),
        (wayfix.Hmm(start, scipy.sparse.coo_array(moves), logarithms=True, start_before_move=before), logs),
    ]
    for hmm, ys in models:
        assert hmm.states == n
        if not paths:
            with pytest.raises(wayfix.ImpossibleError) as raised:
                hmm.score(ys)
            assert 1 <= raised.value.step <= len(ys)
            continue
        total = sum(paths.values())
        assert hmm.score(ys) == pytest.approx(np.log(total), abs=1e-10)
        marginals = np.zeros((len(ys), n))
        for path, p in paths.items():
            marginals[np.arange(len(ys)), path[before:]] += p / total
        smoothed = hmm.smooth(ys)
        assert smoothed.log_likelihood == pytest.approx(np.log(total), abs=1e-10)
        np.testing.assert_allclose(smoothed.probabilities, marginals, atol=1e-12)
        forward = hmm.forward(ys)
        np.testing.assert_allclose(forward.probabilities[-1], marginals[-1], atol=1e-12)
        best = hmm.viterbi(ys)
        # The state before the first observation is summed out.
        scores = {}
        for path, p in paths.items():
            scores[path[before:]] = scores.get(path[before:], 0) + p
        assert best.log_probability == pytest.approx(np.log(max(scores.values())), abs=1e-10)
        assert scores[tuple(best.states.tolist())] == pytest.approx(max(scores.values()), rel=1e-10)
        live = hmm.filter()
        for k, y in enumerate(ys):
            live.step(y)
            np.testing.assert_allclose(live.belief, forward.probabilities[k], atol=1e-12)
        assert (live.steps, live.mode) == (len(ys), forward.probabilities[-1].argmax())
        assert live.log_likelihood == pytest.approx(np.log(total), abs=1e-10)


def test_many_are_as_one():
    rng = np.random.default_rng(1)
    start, moves, table = random_model(rng, zeros=0)
    hmm = wayfix.Hmm(start, moves, table=table)
    many = [rng.integers(0, table.shape[1], length) for length in rng.integers(1, 40, 200)]
    np.testing.assert_allclose(hmm.score_all(many), [hmm.score(ys) for ys in many], rtol=1e-12)
    for ys, smoothed, path in zip(many, hmm.smooth_all(many), hmm.viterbi_all(many), strict=True):
        np.testing.assert_allclose(smoothed.probabilities, hmm.smooth(ys).probabilities, atol=1e-12)
        assert (path.states == hmm.viterbi(ys).states).all()
    assert hmm.score_all([]).shape == (0,)


@pytest.mark.parametrize("n_jobs", [1, 3])
@pytest.mark.parametrize("table", [False, True])
def test_lengths_threads_and_progress(table, n_jobs):
    rng = np.random.default_rng(5)
    start, moves, symbols = random_model(rng, zeros=0)
    hmm = wayfix.Hmm(start, moves, table=symbols if table else None)
    lengths = rng.integers(0, 30, 100)
    ys = rng.integers(0, symbols.shape[1], lengths.sum()) if table else rng.random((lengths.sum(), len(start)))
    parts = np.split(ys, np.cumsum(lengths)[:-1])
    calls = []
    found = hmm.score_all(ys, lengths, n_jobs=n_jobs, progress=lambda *call: calls.append(call))
    assert calls[-1] == (100, 100) and all(0 <= done <= total == 100 for done, total in calls)
    np.testing.assert_allclose(found, [hmm.score(part) for part in parts], rtol=1e-12)
    for part, smoothed, path in zip(parts, hmm.smooth_all(parts, n_jobs=n_jobs),
                                    hmm.viterbi_all(ys, lengths, n_jobs=n_jobs), strict=True):
        np.testing.assert_allclose(smoothed.probabilities, hmm.smooth(part).probabilities, atol=1e-12)
        assert (path.states == hmm.viterbi(part).states).all()
    for bad in [lengths[1:], [-1], lengths + 0.5, [2**62] * 4]:
        with pytest.raises(wayfix.Error):
            hmm.score_all(ys, bad, n_jobs=n_jobs)
    with pytest.raises(KeyError):
        hmm.score_all(ys, lengths, n_jobs=n_jobs, progress=lambda *_: {}["missing"])
    assert hmm.score_all([], n_jobs=n_jobs).shape == (0,)


@pytest.mark.parametrize("n_jobs", [1, 4])
def test_the_first_error_is_raised(n_jobs):
    hmm = wayfix.Hmm([1, 0], [[1, 0], [0, 1]], table=[[1, 0], [0, 1]])
    many = [[0, 0]] * 300 + [[0, 0, 1]] + [[0]] * 50 + [[1]]
    for verb in [hmm.score_all, hmm.smooth_all, hmm.viterbi_all]:
        with pytest.raises(wayfix.ImpossibleError) as raised:
            verb(many, n_jobs=n_jobs)
        assert (raised.value.sequence, raised.value.step) == (300, 3)


def test_paths_in_order():
    rng = np.random.default_rng(2)
    start, moves, table = random_model(rng, zeros=0)
    symbols = [0, 1, 1, 0]
    paths = enumerate_paths(start, moves, table.T[symbols], False)
    expected = sorted(paths.values(), reverse=True)[:5]
    found = wayfix.Hmm(start, moves, table=table).k_best(symbols, 5)
    np.testing.assert_allclose([np.exp(path.log_probability) for path in found], expected)


def test_the_error_of_one_of_many():
    hmm = wayfix.Hmm([1, 0], [[1, 0], [0, 1]], table=[[1, 0], [0, 1]])
    with pytest.raises(wayfix.ImpossibleError) as raised:
        hmm.smooth_all([[0, 0], [0, 1]])
    assert (raised.value.sequence, raised.value.step) == (1, 2)
    assert isinstance(raised.value, wayfix.Error) and isinstance(raised.value, ValueError)


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("table", [None, [[0.9, 0.1], [0.3, 0.7]]])
def test_pickles_go_on(sparse, table):
    moves = np.array([[0.9, 0.1], [0.2, 0.8]])
    hmm = wayfix.Hmm([0.5, 0.5], scipy.sparse.csc_array(moves) if sparse else moves, table=table,
                     start_before_move=True)
    ys = [0, 1, 1] if table else [[0.5, 0.1], [0.1, 0.2], [3.0, 0.1]]
    live = hmm.filter()
    live.step(ys[0])
    for other in [pickle.loads(pickle.dumps(live)), copy.copy(live), copy.deepcopy(live)]:
        going = copy.copy(live)
        for y in ys[1:]:
            assert other.step(y) == going.step(y)
        assert other.to_bytes() == going.to_bytes()
    again = pickle.loads(pickle.dumps(hmm))
    assert again.score(ys) == hmm.score(ys)


def test_a_filter_that_raises_stays():
    live = wayfix.Hmm([1, 0], [[1, 0], [0, 1]]).filter()
    live.step([0.5, 0.5])
    before = live.to_bytes()
    for bad in [[0.0, 1.0], [np.nan, 1.0], [-1.0, 1.0], [np.inf, 1.0], [1.0], [], 3, "x", None,
                [[1.0, 1.0]], [1j, 1.0], ["a", "b"], [None, 1.0]]:
        with pytest.raises(wayfix.Error):
            live.step(bad)
        assert live.to_bytes() == before
    with pytest.raises(wayfix.Error):
        live.restore(b"nothing")
    assert live.to_bytes() == before


HOSTILE = {
    "strings": np.array([["a", "b"]]),
    "objects": np.array([[1.0, None]], dtype=object),
    "complex": np.ones((3, 2), dtype=complex),
    "columns": np.ones((3, 3)),
    "axes": np.ones((3, 2, 1)),
    "one axis": np.ones(2),
    "scalar": np.float64(1),
    "nothing": None,
    "ragged": [[1.0, 2.0], [1.0]],
    "nan": np.array([[1.0, np.nan]]),
    "negative": np.array([[1.0, -1.0]]),
    "infinite": np.array([[1.0, np.inf]]),
    "no columns": np.ones((3, 0)),
    "masked": np.ma.masked_array(np.ones((2, 2)), mask=[[0, 1], [0, 0]]),
    "dates": np.zeros((2, 2), dtype="M8[D]"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_arrays(name):
    hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]])
    for verb in [hmm.score, hmm.smooth, hmm.forward, hmm.viterbi, lambda ys: hmm.smooth_all([ys]),
                 lambda ys: hmm.k_best(ys, 2)]:
        with pytest.raises(wayfix.Error):
            verb(HOSTILE[name])


@pytest.mark.parametrize("symbols", [[2], [-1], [0.5], ["a"], [[0]], None, [2**63 - 1]])
def test_hostile_symbols(symbols):
    hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], table=[[0.5, 0.5], [0.1, 0.9]])
    for verb in [hmm.score, hmm.smooth, hmm.viterbi]:
        with pytest.raises(wayfix.Error):
            verb(symbols)


@pytest.mark.parametrize("start, moves, table", [
    ([0.5, 0.6], np.eye(2), None),
    ([0.5, 0.5], np.ones((2, 2)), None),
    ([0.5, 0.5], np.eye(3), None),
    ([0.5, 0.5], np.ones((3, 2)) / 2, None),
    ([0.5, 0.5], scipy.sparse.eye_array(3), None),
    ([0.5, 0.5], ([0, 5], [0, 1], [1.0, 1.0]), None),
    ([0.5, 0.5], ([0, -1], [0, 1], [1.0, 1.0]), None),
    ([0.5, 0.5], ([0, 1], [0, 1]), None),
    ([0.5, 0.5], ([0, 1], [0, 1], [1.0]), None),
    ([0.5, 0.5], np.eye(2), np.eye(3)),
    ([0.5, 0.5], np.eye(2), [[0.5, 0.6], [0.5, 0.5]]),
    ([], np.eye(0), None),
    ([np.nan, 1.0], np.eye(2), None),
])
def test_hostile_models(start, moves, table):
    with pytest.raises(wayfix.Error):
        wayfix.Hmm(start, moves, table=table)


def test_strides_types_and_read_only():
    hmm = wayfix.Hmm([0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]])
    ys = np.random.default_rng(3).random((50, 2))
    expected = hmm.smooth(ys).probabilities
    backwards = np.ascontiguousarray(ys[::-1])[::-1]
    read_only = ys.copy()
    read_only.flags.writeable = False
    for other in [ys.tolist(), np.asfortranarray(ys), backwards, read_only, np.repeat(ys, 3, 1)[:, ::3]]:
        assert (hmm.smooth(other).probabilities == expected).all()
    single = hmm.smooth(ys.astype(np.float32)).probabilities
    np.testing.assert_allclose(single, expected, atol=1e-6)
    assert hmm.smooth(np.empty((0, 2))).probabilities.shape == (0, 2)
