"""Families of several numbers, of directions, and with zeros, against densities of scipy and M-steps in numpy."""

import functools
import pickle

import numpy as np
import pytest
import scipy.special
import scipy.stats
import wayfix
from test_learning import parts, smooth
from wayfix.learning import Family, learn

MEANS = np.array([[0.0, 1.0], [2.0, -1.0]])
COVARIANCES = np.array([[[1.0, 0.3], [0.3, 2.0]], [[2.0, -0.5], [-0.5, 0.5]]])
POINTS = [[0.1, 0.4], [3.0, -2.0], [-1.0, 5.0]]
UNIT = [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [-0.48, 0.64, 0.6]]
ANGLES = [[0.0], [1.3], [-3.0]]
COUNTS = [[0], [1], [4]]


def normal(mean, covariance):
    return scipy.stats.multivariate_normal(mean, covariance).logpdf


def mixture(k):
    weights, means = [[0.3, 0.7], [0.5, 0.5]][k], [[0.0, 3.0], [5.0, 6.0]][k]
    parts = [lambda y, w=w, m=m, v=v: np.log(w) + scipy.stats.norm(m, v**0.5).logpdf(y[:, 0])
             for w, m, v in zip(weights, means, [[1.0, 2.0], [0.5, 4.0]][k], strict=True)]
    return lambda y: scipy.special.logsumexp([part(y) for part in parts], axis=0)


def beside(law, p, kind):
    """Zero-inflated or hurdle counts."""
    def log(y):
        y, none = y[:, 0], law.pmf(0)
        if kind == "hurdle":
            return np.where(y == 0, np.log(p), np.log1p(-p) + law.logpmf(y) - np.log1p(-none))
        return np.where(y == 0, np.log(p + (1 - p) * none), np.log1p(-p) + law.logpmf(y))
    return log


def points_and_zeros(law, p):
    """A point mass at 0 mixed with a density."""
    return lambda y: np.where(y[:, 0] == 0, np.log(p), np.log1p(-p) + law.logpdf(np.maximum(y[:, 0], 1e-300)))


def counted(m, a):
    return scipy.stats.nbinom(1 / a, 1 / (1 + a * m))


FULL = dict(means=MEANS, covariances=COVARIANCES)
FAMILIES = {
    "gaussian full": (dict(covariance_type="full", **FULL), lambda k: normal(MEANS[k], COVARIANCES[k]), POINTS),
    "gaussian tied": (dict(covariance_type="tied", means=MEANS, covariances=COVARIANCES[0]),
                      lambda k: normal(MEANS[k], COVARIANCES[0]), POINTS),
    "gaussian spherical": (dict(covariance_type="spherical", means=MEANS, covariances=[0.5, 2.0]),
                           lambda k: normal(MEANS[k], [0.5, 2.0][k]), POINTS),
    "gaussian_mixture": (dict(covariance_type="diagonal", weights=[[0.3, 0.7], [0.5, 0.5]],
                              means=[[[0.0], [3.0]], [[5.0], [6.0]]], covariances=[[[1.0], [2.0]], [[0.5], [4.0]]]),
                         mixture, [[0.1], [3.0], [7.0]]),
    "student_t full": (dict(scale_type="full", degrees=[3.0, 5.0], means=MEANS, scales=COVARIANCES),
                       lambda k: scipy.stats.multivariate_t(MEANS[k], COVARIANCES[k], [3, 5][k]).logpdf, POINTS),
    "linear_regression": (dict(coefficients=[[0.5], [-2.0]], intercepts=[[1.0], [0.0]], covariances=[[1.0], [4.0]]),
                          lambda k: lambda y: scipy.stats.norm([0.5, -2][k] * y[:, 0] + [1, 0][k], [1, 2][k]).logpdf(y[:, 1]),
                          POINTS),
    "multinomial": (dict(probabilities=[[0.5, 0.4, 0.1], [0.2, 0.2, 0.6]]),
                    lambda k: lambda y: np.array([scipy.stats.multinomial(row.sum(), [[0.5, 0.4, 0.1], [0.2, 0.2, 0.6]][k]).logpmf(row)
                                                  for row in y]),
                    [[5, 3, 1], [0, 0, 2], [1, 4, 9]]),
    "negative_binomial": (dict(means=[[2.0], [9.0]], dispersions=[[0.5], [1.5]]),
                          lambda k: lambda y: counted([2, 9][k], [0.5, 1.5][k]).logpmf(y[:, 0]), COUNTS),
    "von_mises_fisher": (dict(means=UNIT[:2], concentrations=[20.0, 5.0]),
                         lambda k: scipy.stats.vonmises_fisher(UNIT[k], [20, 5][k]).logpdf, UNIT),
    "wrapped_cauchy": (dict(means=[[3.1], [0.5]], concentrations=[[0.2], [0.9]]),
                       lambda k: lambda y: scipy.stats.wrapcauchy([0.2, 0.9][k]).logpdf((y[:, 0] - [3.1, 0.5][k]) % (2 * np.pi)),
                       ANGLES),
    "zero_inflated_poisson": (dict(probabilities=[[0.2], [0.6]], inner=dict(rates=[[2.0], [9.0]])),
                              lambda k: beside(scipy.stats.poisson([2, 9][k]), [0.2, 0.6][k], "inflated"), COUNTS),
    "zero_inflated_negative_binomial": (dict(probabilities=[[0.2], [0.6]], inner=dict(means=[[2.0], [9.0]], dispersions=[[0.5], [1.5]])),
                                        lambda k: beside(counted([2, 9][k], [0.5, 1.5][k]), [0.2, 0.6][k], "inflated"), COUNTS),
    "zero_inflated_binomial": (dict(probabilities=[[0.2], [0.6]], inner=dict(trials=[[5], [5]], probabilities=[[0.3], [0.7]])),
                               lambda k: beside(scipy.stats.binom(5, [0.3, 0.7][k]), [0.2, 0.6][k], "inflated"), COUNTS),
    "zero_inflated_gamma": (dict(probabilities=[[0.2], [0.6]], inner=dict(shapes=[[2.0], [0.5]], scales=[[1.0], [3.0]])),
                            lambda k: points_and_zeros(scipy.stats.gamma([2, 0.5][k], scale=[1, 3][k]), [0.2, 0.6][k]), [[0.0], [0.5], [3.0]]),
    "zero_inflated_log_normal": (dict(probabilities=[[0.2], [0.6]], inner=dict(means=[[0.0], [2.0]], deviations=[[1.0], [2.0]])),
                                 lambda k: points_and_zeros(scipy.stats.lognorm([1, 2][k], scale=np.exp([0, 2][k])), [0.2, 0.6][k]), [[0.0], [0.5], [3.0]]),
    "zero_inflated_weibull": (dict(probabilities=[[0.2], [0.6]], inner=dict(shapes=[[1.0], [2.0]], scales=[[1.0], [4.0]])),
                              lambda k: points_and_zeros(scipy.stats.weibull_min([1, 2][k], scale=[1, 4][k]), [0.2, 0.6][k]), [[0.0], [0.5], [3.0]]),
    "hurdle_poisson": (dict(probabilities=[[0.2], [0.6]], inner=dict(rates=[[2.0], [9.0]])),
                       lambda k: beside(scipy.stats.poisson([2, 9][k]), [0.2, 0.6][k], "hurdle"), COUNTS),
    "hurdle_negative_binomial": (dict(probabilities=[[0.2], [0.6]], inner=dict(means=[[2.0], [9.0]], dispersions=[[0.5], [1.5]])),
                                 lambda k: beside(counted([2, 9][k], [0.5, 1.5][k]), [0.2, 0.6][k], "hurdle"), COUNTS),
    "hurdle_binomial": (dict(probabilities=[[0.2], [0.6]], inner=dict(trials=[[5], [5]], probabilities=[[0.3], [0.7]])),
                        lambda k: beside(scipy.stats.binom(5, [0.3, 0.7][k]), [0.2, 0.6][k], "hurdle"), COUNTS),
}


@pytest.mark.parametrize("name", FAMILIES)
def test_densities(name):
    parameters, log, rows = FAMILIES[name]
    kind = name.split()[0]
    family = Family(kind, **parameters)
    rows = np.array(rows, float)
    found = family.log_likelihoods(rows)
    np.testing.assert_allclose(found, np.array([log(k)(rows) for k in range(2)]).T, rtol=1e-9, atol=1e-12)
    again = pickle.loads(pickle.dumps(family))
    assert (again.kind, again.parameters) == (kind, family.parameters)
    np.testing.assert_array_equal(again.log_likelihoods(rows), found)


def data(kind):
    rng = np.random.default_rng(5)
    state = np.repeat([0, 1] * 3, 100)
    return {
        "positive": np.where(state == 0, rng.gamma(2, 1, 600), rng.gamma(4, 3, 600)),
        "zeros": np.where(rng.random(600) < 0.3, 0, np.where(state == 0, rng.gamma(2, 1, 600), rng.gamma(4, 3, 600))),
        "counts": np.where(rng.random(600) < 0.3, 0, np.where(state == 0, rng.negative_binomial(2, 0.5, 600), rng.negative_binomial(3, 0.2, 600))),
        "few": np.where(rng.random(600) < 0.3, 0, rng.binomial(5, np.where(state == 0, 0.3, 0.8))),
        "angles": rng.vonmises(np.where(state == 0, 0.5, 2.5), np.where(state == 0, 1.0, 6.0)),
        "shares": np.where(state == 0, rng.beta(2, 4, 600), rng.beta(6, 2, 600)),
    }[kind].astype(float)[:, None]


#: Families of one number, what is learned from, and their first parameters.
LEARNED = {
    "beta": ("shares", dict(alphas=[[2.0], [3.0]], betas=[[3.0], [2.0]])),
    "gamma": ("positive", dict(shapes=[[1.0], [2.0]], scales=[[1.0], [5.0]])),
    "weibull": ("positive", dict(shapes=[[1.0], [2.0]], scales=[[2.0], [9.0]])),
    "log_normal": ("positive", dict(means=[[0.0], [2.0]], deviations=[[1.0], [1.0]])),
    "negative_binomial": ("counts", dict(means=[[2.0], [9.0]], dispersions=[[0.5], [0.5]])),
    "von_mises": ("angles", dict(means=[[0.5], [2.5]], concentrations=[[1.0], [4.0]])),
    "wrapped_cauchy": ("angles", dict(means=[[0.5], [2.5]], concentrations=[[0.3], [0.6]])),
    "zero_inflated_poisson": ("counts", dict(probabilities=[[0.2], [0.3]], inner=dict(rates=[[2.0], [9.0]]))),
    "zero_inflated_binomial": ("few", dict(probabilities=[[0.2], [0.3]], inner=dict(trials=[[5], [5]], probabilities=[[0.3], [0.7]]))),
    "zero_inflated_gamma": ("zeros", dict(probabilities=[[0.2], [0.3]], inner=dict(shapes=[[2.0], [2.0]], scales=[[1.0], [5.0]]))),
    "hurdle_poisson": ("counts", dict(probabilities=[[0.2], [0.3]], inner=dict(rates=[[2.0], [9.0]]))),
    "hurdle_negative_binomial": ("counts", dict(probabilities=[[0.2], [0.3]], inner=dict(means=[[2.0], [9.0]], dispersions=[[0.5], [0.5]]))),
}


STICKY = [[0.95, 0.05], [0.05, 0.95]]


@pytest.mark.parametrize("kind", LEARNED)
def test_learning_ends_at_a_maximum(kind):
    of, given = LEARNED[kind]
    rows = data(of)
    hmm = wayfix.Hmm([0.5, 0.5], STICKY, logarithms=True)
    learned = learn(hmm, [rows], Family(kind, **given), iterations=3000, tolerance=1e-11)
    start, moves, _ = parts(learned.hmm)

    def score(place, factor):
        parameters = copied(learned.family.parameters, given)
        if place:
            *path, state = place
            functools.reduce(lambda part, name: part[name], path, parameters)[state][0] *= factor
        return smooth(start, moves, np.exp(Family(kind, **parameters).log_likelihoods(rows)))[2]

    best = score((), 1)
    assert best == pytest.approx(learned.log_likelihood, rel=1e-9)
    places = [(name,) for name in given if name != "inner"] + [("inner", name) for name in given.get("inner", {})]
    for place in places:
        for state in range(2) if place[-1] != "trials" else ():
            assert max(score((*place, state), 1 + step) - best for step in (-1e-4, 1e-4)) < 1e-7, (place, state)


def copied(parameters, names):
    """Only the parameters with these names."""
    return {name: copied(parameters[name], of) if isinstance(of, dict) else [list(row) for row in parameters[name]]
            for name, of in names.items()}


def expected(family, rows):
    """Probabilities of the states at each row, in numpy."""
    return smooth(np.array([0.5, 0.5]), np.array(STICKY), np.exp(family.log_likelihoods(rows)))[0]


def after_one_step(family, rows):
    hmm = wayfix.Hmm([0.5, 0.5], STICKY, logarithms=True)
    return learn(hmm, [rows], family, iterations=1, tolerance=0).family.parameters


def test_a_step_of_learning_in_closed_form():
    rng = np.random.default_rng(6)
    state = np.repeat([0, 1] * 3, 50)

    counts = rng.multinomial(7, [0.2, 0.3, 0.5], 300) + 3 * state[:, None] * np.array([1, 0, 0])
    family = Family("multinomial", probabilities=[[0.2, 0.3, 0.5], [0.5, 0.3, 0.2]])
    sums = expected(family, counts.astype(float)).T @ counts
    found = after_one_step(family, counts.astype(float))
    np.testing.assert_allclose(found["probabilities"], sums / sums.sum(axis=1, keepdims=True), rtol=1e-9)

    x = rng.normal(size=300)
    rows = np.stack([x, np.where(state == 0, x, 3 - 2 * x) + rng.normal(size=300)], axis=1)
    family = Family("linear_regression", coefficients=[[0.5], [-1.0]], intercepts=[[0.0], [2.0]], covariances=[[1.0], [1.0]])
    found = after_one_step(family, rows)
    for k, weights in enumerate(expected(family, rows).T):
        (slope, constant), root = np.polyfit(x, rows[:, 1], 1, w=np.sqrt(weights)), rows[:, 1]
        np.testing.assert_allclose([found["coefficients"][k], found["intercepts"][k]], [[slope], [constant]], rtol=1e-8)
        np.testing.assert_allclose(found["covariances"][k], np.average((root - slope * x - constant) ** 2, weights=weights), rtol=1e-8)

    rows = np.where(state[:, None] == 0, rng.multivariate_normal(MEANS[0], COVARIANCES[0], 300), rng.multivariate_normal(MEANS[1], COVARIANCES[1], 300))
    family = Family("gaussian", covariance_type="full", means=MEANS, covariances=[np.eye(2)] * 2)
    found = after_one_step(family, rows)
    for k, weights in enumerate(expected(family, rows).T):
        np.testing.assert_allclose(found["means"][k], np.average(rows, axis=0, weights=weights), rtol=1e-9)
        np.testing.assert_allclose(found["covariances"][k], np.cov(rows.T, aweights=weights, ddof=0), rtol=1e-8)

    rows = np.where(state[:, None] == 0, scipy.stats.vonmises_fisher(UNIT[0], 9).rvs(300, rng), scipy.stats.vonmises_fisher(UNIT[1], 4).rvs(300, rng))
    family = Family("von_mises_fisher", means=UNIT[:2], concentrations=[2.0, 2.0])
    found = after_one_step(family, rows)
    for k, weights in enumerate(expected(family, rows).T):
        mean = np.average(rows, axis=0, weights=weights)
        length = np.linalg.norm(mean)
        np.testing.assert_allclose(found["means"][k], mean / length, rtol=1e-9)
        # In three dimensions, the mean resultant length is coth(x) - 1/x.
        x = found["concentrations"][k]
        assert 1 / np.tanh(x) - 1 / x == pytest.approx(length, rel=1e-9)

    rows = np.where(state == 0, rng.normal(0, 1, 300), rng.choice([4.0, 8.0], 300) + rng.normal(size=300))[:, None]
    family = Family("gaussian_mixture", **FAMILIES["gaussian_mixture"][0])
    found = after_one_step(family, rows)
    for k, weights in enumerate(expected(family, rows).T):
        means, variances, shares = ([0.0, 3.0], [5.0, 6.0])[k], ([1.0, 2.0], [0.5, 4.0])[k], ([0.3, 0.7], [0.5, 0.5])[k]
        parts_of = shares * scipy.stats.norm(means, np.sqrt(variances)).pdf(rows)
        parts_of *= (weights / parts_of.sum(axis=1))[:, None]
        np.testing.assert_allclose(found["weights"][k], parts_of.sum(axis=0) / weights.sum(), rtol=1e-9)
        mean = (parts_of * rows).sum(axis=0) / parts_of.sum(axis=0)
        np.testing.assert_allclose(np.ravel(found["means"][k]), mean, rtol=1e-9)
