"""`wayfix.hmmlearn` with little data, narrow types, and invalid data."""

import numpy as np
import pytest
import wayfix
from wayfix.hmmlearn import base
from wayfix.hmmlearn import hmm as ours


def chain(model, n=2):
    model.startprob_ = np.full(n, 1 / n)
    model.transmat_ = np.full((n, n), 0.2 / (n - 1)) + np.eye(n) * (0.8 - 0.2 / (n - 1))
    return model


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.float16, np.float32])
@pytest.mark.parametrize("family", ["spherical", "diag", "full", "tied"])
def test_narrow_numbers_do_not_overflow(kind, family):
    X = np.random.default_rng(0).integers(90, 127, (60, 2)).astype(kind)

    def fitted(X):
        return ours.GaussianHMM(2, family, random_state=0, n_iter=5).fit(X)

    narrow, wide = fitted(X), fitted(X.astype(float))
    assert narrow.score(X) == pytest.approx(wide.score(X.astype(float)), rel=1e-9)
    np.testing.assert_allclose(narrow.covars_, wide.covars_, rtol=1e-7)


def test_narrow_counts_do_not_wrap():
    model = chain(ours.MultinomialHMM(2, n_trials=255))
    model.emissionprob_ = [[0.9, 0.1], [0.5, 0.5]]
    X = np.array([[255, 0], [200, 55]], dtype=np.uint8)
    assert model.score(X) == pytest.approx(model.score(X.astype(int)), rel=1e-14)


def test_draws_of_a_fitted_spherical_model_have_its_variance():
    rng = np.random.default_rng(1)
    X = np.concatenate([rng.normal(0, 1, (200, 2)), rng.normal(20, 5, (200, 2))])
    model = ours.GaussianHMM(2, "spherical", random_state=0).fit(X)
    assert model.covars_.shape == (2, 2, 2)
    draws, states = model.sample(4000, random_state=2)
    for state in range(2):
        shown = draws[states == state].var(axis=0)
        np.testing.assert_allclose(shown, np.diag(model.covars_[state]), rtol=0.15)


@pytest.mark.parametrize("kind, covars", [
    ("diag", np.ones((2, 1))), ("diag", np.ones((2, 4))), ("full", np.ones((2, 1, 1))),
    ("tied", np.eye(3)), ("spherical", np.ones((2, 3))), ("spherical", [[1.0, 2.0], [1.0, 1.0]]),
])
def test_covariances_of_another_shape_are_refused(kind, covars):
    model = chain(ours.GaussianHMM(2, kind))
    model.means_ = np.zeros((2, 2))
    with pytest.raises(ValueError, match="variance|covars_"):
        model.covars_ = covars
        model.score(np.zeros((3, 2)))


def test_what_was_never_seen_stays():
    left_right = ours.CategoricalHMM(3, n_features=3, params="te", init_params="", n_iter=3)
    left_right.startprob_ = [1, 0, 0]
    left_right.transmat_ = [[0.5, 0.5, 0], [0, 0.5, 0.5], [0, 0.25, 0.75]]
    left_right.emissionprob_ = [[1, 0, 0], [0, 1, 0], [0, 0.2, 0.8]]
    left_right.fit(np.array([[0], [0], [1]]))
    assert left_right.transmat_[2].tolist() == [0, 0.25, 0.75]
    np.testing.assert_allclose(left_right.transmat_.sum(axis=1), 1)
    np.testing.assert_allclose(left_right.emissionprob_.sum(axis=1), 1)
    assert np.isfinite(left_right.score(np.array([[0], [1]])))

    never = ours.MultinomialHMM(2, n_trials=2, params="e", init_params="")
    never.startprob_, never.transmat_ = [1, 0], np.eye(2)
    never.emissionprob_ = [[0.5, 0.5], [0.3, 0.7]]
    never.fit(np.array([[1, 1], [2, 0]]))
    assert never.emissionprob_[1].tolist() == [0.3, 0.7]


@pytest.mark.parametrize("prior", [0.0, 0.5])
def test_priors_below_one_leave_distributions(prior):
    X = np.random.default_rng(3).integers(0, 3, (40, 1))
    model = ours.CategoricalHMM(3, startprob_prior=prior, transmat_prior=prior,
                                emissionprob_prior=prior, random_state=0).fit(X)
    for values in [model.startprob_, model.transmat_, model.emissionprob_]:
        np.testing.assert_allclose(values.sum(axis=-1), 1)


def test_counts_that_do_not_vary():
    X = np.full((20, 1), 3)
    model = ours.PoissonHMM(2, random_state=0).fit(X)
    np.testing.assert_allclose(model.lambdas_, 3)
    assert np.isfinite(model.score(X))


class Calls(ours.GaussianHMM):
    def _accumulate_sufficient_statistics(self, stats, X, lattice, posteriors, forward, backward):
        super()._accumulate_sufficient_statistics(stats, X, lattice, posteriors, forward, backward)
        stats["calls"] = stats.get("calls", 0) + 1

    def _do_mstep(self, stats):
        super()._do_mstep(stats)
        self.calls_ = stats["calls"]


def test_a_subclass_sees_sequence_by_sequence():
    X = np.random.default_rng(4).normal(size=(30, 1))
    assert Calls(2, random_state=0).fit(X, [10, 0, 5, 15]).calls_ == 3


def test_multinomial_input_is_checked():
    model = chain(ours.MultinomialHMM(2, n_trials=2))
    model.emissionprob_ = [[0.5, 0.5], [0.1, 0.9]]
    assert np.isfinite(model.score([[1.0, 1.0]]))
    for X in [[[0.5, 1.5]], [[-1, 3]], [[np.nan, 1]]]:
        with pytest.raises(ValueError):
            model.score(X)
    for rows in [[[0.5, 0.6], [0.1, 0.9]], [[1.5, -0.5], [0.1, 0.9]]]:
        model.emissionprob_ = rows
        with pytest.raises(ValueError, match="emissionprob_ must sum to 1"):
            model.score([[1, 1]])


@pytest.mark.parametrize("lengths", [[10.9], [-1, 11], [5, 4], [5, 6], [np.nan], ["a"]])
def test_lengths_are_checked(lengths):
    model = chain(ours.PoissonHMM(2))
    model.lambdas_ = [[1.0], [4.0]]
    with pytest.raises(ValueError):
        model.score(np.ones((10, 1), dtype=int), lengths)


def test_sequences_are_counted_as_given():
    model = chain(ours.CategoricalHMM(2))
    model.emissionprob_ = [[1, 0], [1, 0]]
    with pytest.raises(wayfix.ImpossibleError) as raised:
        model.score([[0], [0], [1]], [0, 1, 0, 2])
    assert (raised.value.sequence, raised.value.step) == (3, 2)
    assert "sequence 3" in str(raised.value)
    states = model.decode([[0], [0], [0]], [0, 1, 0, 2])[1]
    assert len(states) == 3 == len(model.predict_proba([[0], [0], [0]], [0, 3, 0]))


def test_one_row():
    model = ours.GMMHMM(2, 2, init_params="", n_iter=1)
    chain(model)
    model.n_features = 1
    model.weights_ = np.full((2, 2), 0.5)
    model.means_, model.covars_ = np.arange(4.0).reshape(2, 2, 1), np.ones((2, 2, 1))
    model.fit([[0.5]])
    assert np.isfinite(model.score([[0.5]]))


@pytest.mark.parametrize("X", [np.ma.masked_array([[1], [2]], mask=[[0], [1]]), [[np.nan], [1]], [], [1, 2]])
def test_hostile_data(X):
    model = chain(ours.PoissonHMM(2))
    model.lambdas_ = [[1.0], [4.0]]
    for verb in [model.score, model.decode, ours.PoissonHMM(2).fit]:
        with pytest.raises(ValueError):
            verb(X)


def test_arguments_are_checked():
    model = chain(ours.PoissonHMM(2, implementation="fast"))
    model.lambdas_ = [[1.0], [4.0]]
    with pytest.raises(ValueError, match="implementation"):
        model.score([[1]])
    model.implementation = "log"
    with pytest.raises(ValueError, match="n_samples"):
        model.sample(0)


def test_where_answers_differ():
    theirs = pytest.importorskip("hmmlearn.hmm")
    assert ours.BaseHMM is base.BaseHMM
    X = np.random.default_rng(0).normal(size=(100, 2)) + np.repeat([[0], [4]], 50, axis=0)
    named = dict(n_components=2, covariance_type="spherical", random_state=0)
    mine, other = ours.GaussianHMM(**named).fit(X), theirs.GaussianHMM(**named).fit(X)
    assert mine.covars_.shape == (2, 2, 2) and other.covars_.shape == (4, 2, 2)
    np.testing.assert_allclose(mine.covars_, other.covars_[::2], rtol=1e-6)
    alike = ours.CategoricalHMM(3)
    alike.startprob_, alike.transmat_ = np.full(3, 1 / 3), np.full((3, 3), 1 / 3)
    alike.emissionprob_ = np.full((3, 2), 0.5)
    assert alike.decode([[0], [1], [0]])[1].tolist() == [0, 0, 0]
    with pytest.raises(wayfix.Error, match="step 2"):
        ours.PoissonHMM(1).fit([[1], [-2], [3]])
    with pytest.raises(ValueError, match="n_samples is 0"):
        mine.sample(0)
