"""Symbols and counts: categorical, multinomial and Poisson."""

import logging

import numpy as np
from scipy import special
from sklearn.utils import check_random_state

from .. import _wayfix
from .base import BaseHMM
from .utils import distributions, normalize

_log = logging.getLogger(__name__)


def _are_counts(X):
    return np.issubdtype(X.dtype, np.integer) and (X.size == 0 or X.min() >= 0)


class _EmissionHMM(BaseHMM):
    """Hidden Markov model with a table ``emissionprob_`` that has a row for each state; letter e."""

    emissionprob_prior = 1.0

    def _get_n_fit_scalars_per_param(self):
        n, m = self.n_components, self.n_features
        return {"s": n - 1, "t": n * (n - 1), "e": n * (m - 1)}

    def _init(self, X, lengths=None):
        super()._init(X, lengths)
        self.random_state = check_random_state(self.random_state)
        if self._needs_init("e", "emissionprob_"):
            self.emissionprob_ = self.random_state.rand(self.n_components, self.n_features)
            normalize(self.emissionprob_, axis=1)

    def _check(self):
        super()._check()
        self.emissionprob_ = np.atleast_2d(self.emissionprob_)
        if getattr(self, "n_features", None) is None:
            self.n_features = self.emissionprob_.shape[1]
        expected = (self.n_components, self.n_features)
        if self.emissionprob_.shape != expected:
            raise ValueError(f"emissionprob_ has shape {self.emissionprob_.shape}, expected {expected}")
        self._check_sum_1("emissionprob_")

    def _initialize_sufficient_statistics(self):
        stats = super()._initialize_sufficient_statistics()
        stats["obs"] = np.zeros((self.n_components, self.n_features))
        return stats

    def _do_mstep(self, stats):
        super()._do_mstep(stats)
        if "e" in self.params:
            weights = self.emissionprob_prior - 1 + stats["obs"]
            self.emissionprob_ = distributions(weights, self.emissionprob_)


class CategoricalHMM(_EmissionHMM):
    """Hidden Markov model of symbols 0, 1, …; X has shape (n_samples, 1).

    Parameters
    ----------
    emissionprob_prior : array or float
        Parameters of the Dirichlet priors of the rows of ``emissionprob_``.
    n_features : int, optional
        Number of symbols; by default one more than the largest symbol in ``fit``.

    Attributes
    ----------
    emissionprob_ : array, shape (n_components, n_features)
        Probabilities of the symbols in each state; letter e.
    """

    _adds_all_at_once = True

    def __init__(self, n_components=1, startprob_prior=1.0, transmat_prior=1.0, *,
                 emissionprob_prior=1.0, n_features=None, algorithm="viterbi", random_state=None,
                 n_iter=10, tol=1e-2, verbose=False, params="ste", init_params="ste",
                 implementation="log"):
        super().__init__(
            n_components, startprob_prior, transmat_prior, algorithm, random_state, n_iter, tol,
            verbose, params, init_params, implementation)
        self.emissionprob_prior = emissionprob_prior
        self.n_features = n_features

    def _check_and_set_n_features(self, X):
        if not _are_counts(X):
            raise ValueError("symbols must be integers from 0")
        if self.n_features is None:
            self.n_features = int(X.max()) + 1
        elif X.max() >= self.n_features:
            raise ValueError(f"symbol {X.max()}, expected at most {self.n_features - 1}")

    def _symbols(self, X):
        if X.shape[1] != 1:
            raise ValueError(f"X has {X.shape[1]} columns, expected 1")
        if not _are_counts(X) or X.max() >= self.n_features:
            raise ValueError(f"symbols must be integers from 0 to {self.n_features - 1}")
        return X[:, 0]

    def _compute_likelihood(self, X):
        return self.emissionprob_.T[self._symbols(X)]

    def _compute_log_likelihood(self, X):
        with np.errstate(divide="ignore"):
            return np.log(self.emissionprob_.T)[self._symbols(X)]

    def _accumulate_sufficient_statistics(
            self, stats, X, lattice, posteriors, fwdlattice, bwdlattice):
        if "e" in self.params:
            symbols = self._symbols(X)
            # Sum of the posteriors at each symbol.
            for state in range(self.n_components):
                stats["obs"][state] += np.bincount(
                    symbols, weights=posteriors[:, state], minlength=self.n_features)

    def _generate_sample_from_state(self, state, random_state):
        cumulative = np.cumsum(self.emissionprob_[state])
        return [int((cumulative > random_state.rand() * cumulative[-1]).argmax())]


class MultinomialHMM(_EmissionHMM):
    """Hidden Markov model of the counts of outcomes in a number of trials.

    Parameters
    ----------
    n_trials : int or array of int, optional
        Number of trials of each row, or of all; by default that of the data. ``sample`` needs a single number.

    Attributes
    ----------
    emissionprob_ : array, shape (n_components, n_features)
        Probabilities of the outcomes in each state; letter e.
    """

    _adds_all_at_once = True

    def __init__(self, n_components=1, n_trials=None, startprob_prior=1.0, transmat_prior=1.0,
                 algorithm="viterbi", random_state=None, n_iter=10, tol=1e-2, verbose=False,
                 params="ste", init_params="ste", implementation="log"):
        super().__init__(
            n_components, startprob_prior, transmat_prior, algorithm, random_state, n_iter, tol,
            verbose, params, init_params, implementation)
        self.n_trials = n_trials

    def _check_and_set_n_features(self, X):
        super()._check_and_set_n_features(X)
        if not _are_counts(X):
            raise ValueError("counts must be integers from 0")
        trials = X.sum(axis=1)
        if self.n_trials is None:
            self.n_trials = trials
        elif not (trials == self.n_trials).all():
            raise ValueError("the counts of a row must sum to its number of trials")

    def _check(self):
        super()._check()
        if self.n_trials is None:
            raise ValueError("n_trials must be set")

    def _compute_log_likelihood(self, X):
        # Doubles, since sums of narrow integers would overflow.
        X = np.asarray(X, dtype=np.float64)
        if (X < 0).any() or (X != np.floor(X)).any():
            raise ValueError("counts must be integers from 0")
        # The multinomial coefficient, in logarithms: n! / (x_1! x_2! …).
        orders = special.gammaln(X.sum(axis=1) + 1) - special.gammaln(X + 1).sum(axis=1)
        # `xlogy`, since 0 log 0 is 0: an outcome of probability 0 that does not occur rules nothing out.
        logs = [special.xlogy(X, row).sum(axis=1) for row in self.emissionprob_]
        return orders[:, None] + np.stack(logs, axis=1)

    def _accumulate_sufficient_statistics(
            self, stats, X, lattice, posteriors, fwdlattice, bwdlattice):
        if "e" in self.params:
            stats["obs"] += posteriors.T @ X

    def _generate_sample_from_state(self, state, random_state):
        trials = np.unique(self.n_trials)
        if len(trials) != 1:
            raise ValueError(f"a sample needs one number of trials, found {trials}")
        row = np.asarray(self.emissionprob_[state], dtype=float)
        return random_state.multinomial(int(trials[0]), row / row.sum())


class PoissonHMM(BaseHMM):
    """Hidden Markov model of counts of events.

    Parameters
    ----------
    lambdas_prior, lambdas_weight : array or float
        Shape and rate of the gamma prior of the rates.

    Attributes
    ----------
    lambdas_ : array, shape (n_components, n_features)
        Mean count of each column in each state; letter l.
    """

    _adds_all_at_once = True

    def __init__(self, n_components=1, startprob_prior=1.0, transmat_prior=1.0,
                 lambdas_prior=0.0, lambdas_weight=0.0, algorithm="viterbi", random_state=None,
                 n_iter=10, tol=1e-2, verbose=False, params="stl", init_params="stl",
                 implementation="log"):
        super().__init__(
            n_components, startprob_prior, transmat_prior, algorithm, random_state, n_iter, tol,
            verbose, params, init_params, implementation)
        self.lambdas_prior = lambdas_prior
        self.lambdas_weight = lambdas_weight

    def _get_n_fit_scalars_per_param(self):
        n = self.n_components
        return {"s": n - 1, "t": n * (n - 1), "l": n * self.n_features}

    def _init(self, X, lengths=None):
        super()._init(X, lengths)
        self.random_state = check_random_state(self.random_state)
        if self._needs_init("l", "lambdas_"):
            # Draws from a gamma distribution with the mean and the variance of the data.
            mean, variance, shape = X.mean(), X.var(), (self.n_components, self.n_features)
            if variance > 0:
                self.lambdas_ = self.random_state.gamma(mean**2 / variance, variance / mean, shape)
            else:
                self.lambdas_ = np.full(shape, mean)

    def _check(self):
        super()._check()
        self.lambdas_ = np.atleast_2d(self.lambdas_)
        expected = (self.n_components, getattr(self, "n_features", self.lambdas_.shape[1]))
        if self.lambdas_.shape != expected:
            raise ValueError(f"lambdas_ has shape {self.lambdas_.shape}, expected {expected}")
        self.n_features = expected[1]

    def _compute_log_likelihood(self, X):
        rows = np.ascontiguousarray(X, dtype=np.float64)
        rates = np.ascontiguousarray(self.lambdas_, dtype=np.float64)
        return _wayfix.poisson_log_densities(rows, rates)

    def _initialize_sufficient_statistics(self):
        stats = super()._initialize_sufficient_statistics()
        stats["post"] = np.zeros(self.n_components)
        stats["obs"] = np.zeros((self.n_components, self.n_features))
        return stats

    def _accumulate_sufficient_statistics(
            self, stats, X, lattice, posteriors, fwdlattice, bwdlattice):
        if "l" in self.params:
            stats["post"] += posteriors.sum(axis=0)
            stats["obs"] += posteriors.T @ X

    def _do_mstep(self, stats):
        super()._do_mstep(stats)
        if "l" in self.params:
            # The mean of the gamma posterior. A state without weight keeps its rates.
            weight = self.lambdas_weight + stats["post"][:, None]
            shown = weight[:, 0] > 0
            rates = np.array(self.lambdas_, dtype=float)
            rates[shown] = ((self.lambdas_prior + stats["obs"]) / np.where(weight > 0, weight, 1))[shown]
            self.lambdas_ = rates

    def _generate_sample_from_state(self, state, random_state):
        return random_state.poisson(self.lambdas_[state])
