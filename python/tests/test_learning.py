"""Fixed lag and learning against plain recursions in numpy and densities of scipy."""

import copy
import pickle

import numpy as np
import pytest
import scipy.sparse
import scipy.stats
import wayfix
from wayfix.learning import Family, learn


def smooth(start, moves, likelihoods):
    """Smoothed beliefs, expected moves and log-likelihood, step by step."""
    steps, n = likelihoods.shape
    alpha, beta, log = np.zeros((steps, n)), np.ones((steps, n)), 0.0
    for k in range(steps):
        alpha[k] = likelihoods[k] * (start if k == 0 else alpha[k - 1] @ moves)
        log += np.log(alpha[k].sum())
        alpha[k] /= alpha[k].sum()
    for k in range(steps - 2, -1, -1):
        beta[k] = moves @ (likelihoods[k + 1] * beta[k + 1])
        beta[k] /= beta[k].sum()
    gamma = alpha * beta / (alpha * beta).sum(axis=1, keepdims=True)
    xi = np.zeros((n, n))
    for k in range(steps - 1):
        pair = alpha[k][:, None] * moves * (likelihoods[k + 1] * beta[k + 1])
        xi += pair / pair.sum()
    return gamma, xi, log


def random_model(rng, n=3, symbols=4):
    start, moves, table = (rng.dirichlet(np.ones(width), rows) for width, rows in ((n, 1), (n, n), (symbols, n)))
    return start[0], moves, table


def parts(hmm):
    _, (_, (start, moves), named) = hmm.__reduce__()
    if isinstance(moves, tuple):
        rows, columns, values = moves
        moves = scipy.sparse.coo_array((values, (rows.astype(int), columns.astype(int)))).toarray()
    return start, moves, named["table"]


@pytest.mark.parametrize("kind", [np.asarray, scipy.sparse.csr_array])
def test_learning_a_table(kind):
    rng = np.random.default_rng(0)
    start, moves, table = random_model(rng)
    sequences = [rng.integers(0, 4, length) for length in (7, 1, 20, 2, 50)]
    told = []
    learned = learn(wayfix.Hmm(start, kind(moves), table=table), sequences, iterations=5, tolerance=0,
                    progress=lambda iteration, objective: told.append((iteration, objective)))
    for iteration in range(5):
        first, xi, counts, log = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 4)), 0.0
        for symbols in sequences:
            gamma, pairs, of = smooth(start, moves, table.T[symbols])
            first, xi, log = first + gamma[0], xi + pairs, log + of
            np.add.at(counts.T, symbols, gamma)
        assert learned.objectives[iteration] == pytest.approx(log)
        start = first / first.sum()
        moves = xi / xi.sum(axis=1, keepdims=True)
        table = counts / counts.sum(axis=1, keepdims=True)
    for found, expected in zip(parts(learned.hmm), (start, moves, table), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert told == list(enumerate(learned.objectives))[1:]
    assert (learned.iterations, learned.converged, learned.family) == (5, False, None)
    assert learned.log_likelihood == learned.objectives[-1]
    assert learned.aic == pytest.approx(-2 * learned.log_likelihood + 2 * (2 + 6 + 9))


def test_progress_ends_learning_and_priors_count():
    rng = np.random.default_rng(1)
    start, moves, table = random_model(rng)
    hmm, ys = wayfix.Hmm(start, moves, table=table), [rng.integers(0, 4, 100)]
    learned = learn(hmm, ys, tolerance=0, progress=lambda iteration, _: iteration == 3)
    assert (learned.iterations, learned.stopped) == (3, True)
    kept = learn(hmm, ys, keep_start=True)
    np.testing.assert_array_equal(parts(kept.hmm)[0], start)
    strong = learn(hmm, ys, move_count=1e9, table_count=1e9, iterations=1)
    np.testing.assert_allclose(parts(strong.hmm)[1], 1 / 3, atol=1e-6)
    np.testing.assert_allclose(parts(strong.hmm)[2], 1 / 4, atol=1e-6)

    def fails(iteration, objective):
        raise KeyError(iteration)

    with pytest.raises(KeyError):
        learn(hmm, ys, progress=fails)


FAMILIES = {
    "bernoulli": (dict(probabilities=[[0.2], [0.7]]), lambda k: scipy.stats.bernoulli([0.2, 0.7][k]), [0, 1]),
    "beta": (dict(alphas=[[2.0], [3.0]], betas=[[1.0], [4.0]]), lambda k: scipy.stats.beta([2, 3][k], [1, 4][k]), [0.2, 0.9]),
    "binomial": (dict(trials=[[5], [5]], probabilities=[[0.2], [0.7]]), lambda k: scipy.stats.binom(5, [0.2, 0.7][k]), [0, 4]),
    "exponential": (dict(rates=[[2.0], [0.5]]), lambda k: scipy.stats.expon(scale=[0.5, 2][k]), [0.1, 3]),
    "gamma": (dict(shapes=[[2.0], [0.5]], scales=[[1.0], [3.0]]), lambda k: scipy.stats.gamma([2, 0.5][k], scale=[1, 3][k]), [0.1, 3]),
    "gaussian": (dict(covariance_type="diagonal", means=[[0.0], [2.0]], covariances=[[1.0], [4.0]]),
                 lambda k: scipy.stats.norm([0, 2][k], [1, 2][k]), [0.1, 3]),
    "log_normal": (dict(means=[[0.0], [2.0]], deviations=[[1.0], [2.0]]), lambda k: scipy.stats.lognorm([1, 2][k], scale=np.exp([0, 2][k])), [0.1, 3]),
    "poisson": (dict(rates=[[2.0], [0.5]]), lambda k: scipy.stats.poisson([2, 0.5][k]), [0, 3]),
    "student_t": (dict(scale_type="diagonal", degrees=[3.0, 5.0], means=[[0.0], [2.0]], scales=[[1.0], [4.0]]),
                  lambda k: scipy.stats.t([3, 5][k], [0, 2][k], [1, 2][k]), [0.1, 3]),
    "von_mises": (dict(means=[[0.0], [2.0]], concentrations=[[1.0], [4.0]]), lambda k: scipy.stats.vonmises([1, 4][k], loc=[0, 2][k]), [0.1, 3]),
    "weibull": (dict(shapes=[[1.0], [2.0]], scales=[[1.0], [4.0]]), lambda k: scipy.stats.weibull_min([1, 2][k], scale=[1, 4][k]), [0.1, 3]),
}


@pytest.mark.parametrize("kind", FAMILIES)
def test_families(kind):
    parameters, law, values = FAMILIES[kind]
    family = Family(kind, **parameters)
    rows = np.array(values, float)[:, None]
    found = family.log_likelihoods(rows)
    laws = [law(0), law(1)]
    density = [getattr(one, "logpmf" if hasattr(one.dist, "logpmf") else "logpdf") for one in laws]
    np.testing.assert_allclose(found, np.array([log(values) for log in density]).T, rtol=1e-9, atol=1e-12)
    again = pickle.loads(pickle.dumps(family))
    assert (again.kind, again.parameters) == (kind, family.parameters)
    # Learned from two persistent states; the likelihood never falls.
    rng = np.random.default_rng(2)
    states = np.repeat([0, 1, 0, 1], 60)
    drawn = np.where(states == 0, laws[0].rvs(240, random_state=rng), laws[1].rvs(240, random_state=rng))
    hmm = wayfix.Hmm([0.5, 0.5], [[0.95, 0.05], [0.05, 0.95]], logarithms=True)
    learned = learn(hmm, [drawn[:120, None], drawn[120:, None]], family, iterations=4)
    assert (np.diff(learned.objectives) > -1e-9).all() and learned.iterations >= 1
    scores = learned.hmm.score_all([learned.family.log_likelihoods(part[:, None]) for part in np.split(drawn, 2)])
    assert scores.sum() == pytest.approx(learned.log_likelihood)


def test_learning_a_gaussian():
    rng = np.random.default_rng(3)
    start, moves, _ = random_model(rng, 2)
    rows = [rng.normal(size=(length, 2)) + [[3, 0]] * (rng.random((length, 1)) < 0.5) for length in (30, 40)]
    means, variances = np.array([[0.0, 0.0], [2.0, 1.0]]), np.ones((2, 2))
    family = Family("gaussian", covariance_type="diagonal", means=means, covariances=variances)
    learned = learn(wayfix.Hmm(start, moves, logarithms=True), rows, family, iterations=3, tolerance=0)
    for _ in range(3):
        first, xi, weights = np.zeros(2), np.zeros((2, 2)), []
        for ys in rows:
            b = np.stack([scipy.stats.norm(means[i], np.sqrt(variances[i])).pdf(ys).prod(axis=1) for i in (0, 1)], axis=1)
            gamma, pairs, _ = smooth(start, moves, b)
            first, xi = first + gamma[0], xi + pairs
            weights.append(gamma)
        gamma, all_rows = np.concatenate(weights), np.concatenate(rows)
        start, moves = first / first.sum(), xi / xi.sum(axis=1, keepdims=True)
        means = gamma.T @ all_rows / gamma.sum(axis=0)[:, None]
        variances = gamma.T @ all_rows**2 / gamma.sum(axis=0)[:, None] - means**2
    np.testing.assert_allclose(learned.family.parameters["means"], means, rtol=1e-8)
    np.testing.assert_allclose(learned.family.parameters["covariances"], variances, rtol=1e-7)
    np.testing.assert_allclose(parts(learned.hmm)[1], moves, rtol=1e-8)


@pytest.mark.parametrize("kind", [np.asarray, scipy.sparse.csr_array])
@pytest.mark.parametrize("lag", [0, 1, 3, 20])
def test_fixed_lag(kind, lag):
    rng = np.random.default_rng(lag)
    start, moves, table = random_model(rng)
    symbols = rng.integers(0, 4, 12)
    for hmm, ys in [(wayfix.Hmm(start, kind(moves), table=table), symbols.tolist()),
                    (wayfix.Hmm(start, kind(moves), logarithms=True), np.log(table.T[symbols]))]:
        live = wayfix.FixedLag(hmm, lag)
        for k in range(12):
            live.step(ys[k])
            gamma, _, log = smooth(start, moves, table.T[symbols[:k + 1]])
            assert live.log_likelihood == pytest.approx(log)
            np.testing.assert_allclose(live.belief, gamma[-1])
            for step in range(1, k + 2):
                found = live.get(step)
                if step < k + 1 - lag:
                    assert found is None
                else:
                    np.testing.assert_allclose(found, gamma[step - 1])
            if lag <= k:
                np.testing.assert_array_equal(live.lagged, live.get(k + 1 - lag))
            if k == 6:
                others = [pickle.loads(pickle.dumps(live)), copy.copy(live), copy.deepcopy(live)]
        for other in others:
            for k in range(7, 12):
                other.step(ys[k])
            assert other.to_bytes() == live.to_bytes() and (other.steps, other.lag) == (12, lag)
        live.predict()
        np.testing.assert_allclose(live.belief, others[0].belief @ moves)
        live.restart()
        assert live.steps == 0


TABLE = wayfix.Hmm([1.0, 0.0], [[0.5, 0.5], [0.5, 0.5]], table=[[1.0, 0.0], [0.5, 0.5]])
VECTOR = wayfix.Hmm([0.5, 0.5], [[0.5, 0.5], [0.5, 0.5]], logarithms=True)
POISSON = Family("poisson", rates=[[1.0], [2.0]])


@pytest.mark.parametrize(("call", "message"), [
    (lambda: learn(TABLE, []), "no observation to learn from"),
    (lambda: learn(TABLE, [[0, 2]]), "symbol 2 does not exist"),
    (lambda: learn(TABLE, [[1, 0]]), "sequence 0"),
    (lambda: learn(TABLE, [[0]], POISSON), "without a family"),
    (lambda: learn(VECTOR, [[[0.0]]]), "needs a family"),
    (lambda: learn(VECTOR, [[[0.0]], [[0.0, 1.0]]], POISSON), "2 columns, expected 1"),
    (lambda: learn(VECTOR, [[[np.nan]]], POISSON), "NaN"),
    (lambda: learn(VECTOR, [np.zeros((3, 0))], POISSON), "no observation to learn from"),
    (lambda: learn(VECTOR, [[[1.0]]], Family("poisson", rates=[[1.0]])), "1 states, expected 2"),
    (lambda: learn(TABLE, [[0]], tolerance=-1), "tolerance is -1"),
    (lambda: learn(TABLE, [[0]], iterations=-1), "-1"),
    (lambda: Family("normal"), "expected bernoulli, beta"),
    (lambda: Family("poisson"), "missing field `rates`"),
    (lambda: Family("poisson", rates=[[-1.0]]), "rate of state 0.* is -1"),
    (lambda: Family("poisson", rates=np.array([[np.nan]])), "not JSON compliant"),
    (lambda: Family("poisson", rates=[[1.0]], rate=1), "unknown field `rate`"),
    (lambda: POISSON.log_likelihoods([[0.5]]), "step 1"),
    (lambda: POISSON.log_likelihoods([[1.0, 2.0]]), "2 columns, expected 1"),
    (lambda: wayfix.FixedLag(TABLE, -1), "-1"),
    (lambda: wayfix.FixedLag(TABLE, 1).step(2), "2"),
    (lambda: wayfix.FixedLag(TABLE, 1).step(-1), "-1"),
    (lambda: wayfix.FixedLag(VECTOR, 1).step([np.nan, 0]), "NaN"),
    (lambda: wayfix.FixedLag(TABLE, 1).restore(b""), "state of a FixedLag: EOF"),
])
def test_hostile_input(call, message):
    with pytest.raises(wayfix.Error, match=message):
        call()


def test_what_is_impossible():
    live = wayfix.FixedLag(TABLE, 2)
    live.step(0)
    before = live.to_bytes()
    with pytest.raises(wayfix.ImpossibleError) as raised:
        wayfix.FixedLag(TABLE, 2).step(1)
    assert raised.value.step == 1 and live.to_bytes() == before
    learned = learn(TABLE, [[1, 0], [0, 0, 1]])
    assert [index for index, _ in learned.left_out] == [0]


def test_interrupt(interrupted):
    rng = np.random.default_rng(0)
    start, moves, table = random_model(rng, 60, 4)
    hmm, ys = wayfix.Hmm(start, moves, table=table), [rng.integers(0, 4, 20_000)]
    interrupted(lambda: learn(hmm, ys, tolerance=0, iterations=10_000))
    interrupted(lambda: learn(hmm, ys, tolerance=0, iterations=10_000, progress=lambda *_: None))
