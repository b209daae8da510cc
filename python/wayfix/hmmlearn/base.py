"""Base of all estimators: the parameters of the chain, inference, and re-estimation.

Python computes the log-likelihoods of all rows in all states, and the M-step. Between the two, the compiled part runs
the recursions, in one call for all sequences.
"""

import logging
import math
import string

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils import check_array, check_random_state
from sklearn.utils.validation import check_is_fitted

from .. import _wayfix
from .monitor import ConvergenceMonitor
from .utils import distributions

__all__ = ["DECODER_ALGORITHMS", "BaseHMM", "ConvergenceMonitor"]

_log = logging.getLogger(__name__)

DECODER_ALGORITHMS = frozenset(("viterbi", "map"))


class BaseHMM(BaseEstimator):
    """Hidden Markov model without a family of observations, which subclasses add.

    A family of your own overrides ``_compute_log_likelihood(X)`` (or ``_compute_likelihood(X)``), which returns an
    array of shape (n_samples, n_components). For ``fit`` it also overrides ``_initialize_sufficient_statistics``,
    ``_accumulate_sufficient_statistics`` and ``_do_mstep``, and for ``sample`` ``_generate_sample_from_state``.

    Parameters
    ----------
    n_components : int
        Number of states.
    startprob_prior, transmat_prior : array or float
        Parameters of the Dirichlet priors of ``startprob_`` and of the rows of ``transmat_``.
    algorithm : {"viterbi", "map"}
        Decoder: the most probable path, or the most probable state at each step.
    random_state : RandomState, int or None
        Source of random numbers.
    n_iter, tol, verbose
        Parameters of the ``ConvergenceMonitor``.
    params, init_params : str
        Letters of the parameters that ``fit`` re-estimates, and of those that it initialises: s for ``startprob_``,
        t for ``transmat_``, others by family.
    implementation : {"log", "scaling"}
        Accepted for compatibility: there is one implementation, and it does not underflow.

    Attributes
    ----------
    startprob_ : array, shape (n_components,)
        Probabilities of the states at the first observation.
    transmat_ : array, shape (n_components, n_components)
        Probabilities of moves from the state of the row to that of the column.
    monitor_ : ConvergenceMonitor
        Log-likelihoods of the iterations of ``fit``.
    """

    #: True if the class's statistics are sums over rows, so that all sequences may be added at once.
    _adds_all_at_once = False

    def __init__(self, n_components=1, startprob_prior=1.0, transmat_prior=1.0,
                 algorithm="viterbi", random_state=None, n_iter=10, tol=1e-2, verbose=False,
                 params=string.ascii_letters, init_params=string.ascii_letters,
                 implementation="log"):
        self.n_components = n_components
        self.startprob_prior = startprob_prior
        self.transmat_prior = transmat_prior
        self.algorithm = algorithm
        self.random_state = random_state
        self.n_iter = n_iter
        self.tol = tol
        self.verbose = verbose
        self.params = params
        self.init_params = init_params
        self.implementation = implementation
        self.monitor_ = ConvergenceMonitor(tol, n_iter, verbose)

    # Inference.

    def score(self, X, lengths=None):
        """Returns the log-likelihood of all sequences.

        Parameters
        ----------
        X : array, shape (n_samples, n_features)
            Observations of all sequences, one after another.
        lengths : array of int, optional
            Lengths of the sequences; one sequence if not given.
        """
        X, lengths = self._input(X, lengths)
        return self._call(_wayfix.log_likelihoods, X, lengths).sum().item()

    def score_samples(self, X, lengths=None):
        """Returns the log-likelihood, and the probabilities of all states at each step."""
        X, lengths = self._input(X, lengths)
        scores, posteriors = self._call(_wayfix.smooth, X, lengths)
        return scores.sum().item(), posteriors

    def predict_proba(self, X, lengths=None):
        """Returns the probabilities of all states at each step."""
        return self.score_samples(X, lengths)[1]

    def decode(self, X, lengths=None, algorithm=None):
        """Returns the log-probability of the decoded states, and the states.

        With the decoder "map", the first value is the sum of the largest probabilities of all steps, as in hmmlearn.
        """
        algorithm = algorithm or self.algorithm
        if algorithm not in DECODER_ALGORITHMS:
            raise ValueError(f"unknown decoder {algorithm!r}, expected one of {sorted(DECODER_ALGORITHMS)}")
        if algorithm == "map":
            posteriors = self.predict_proba(X, lengths)
            return posteriors.max(axis=1).sum(), posteriors.argmax(axis=1)
        X, lengths = self._input(X, lengths)
        scores, states = self._call(_wayfix.viterbi, X, lengths)
        return scores.sum().item(), states

    def predict(self, X, lengths=None):
        """Returns the decoded state of each step."""
        return self.decode(X, lengths)[1]

    def sample(self, n_samples=1, random_state=None, currstate=None):
        """Draws a sequence. Returns its observations and its states.

        Parameters
        ----------
        n_samples : int
            Number of steps.
        random_state : RandomState, int or None
            Source of random numbers instead of the estimator's own.
        currstate : int, optional
            First state.
        """
        check_is_fitted(self, "startprob_")
        self._check()
        if n_samples < 1:
            raise ValueError(f"n_samples is {n_samples}, expected at least 1")
        rng = check_random_state(self.random_state if random_state is None else random_state)
        start, moves = np.cumsum(self.startprob_), np.cumsum(self.transmat_, axis=1)

        def draw(cumulative):
            # Rounding may leave the last sum below one, so the draw is scaled by it. Strictly above, so that a state
            # of probability 0 is never drawn.
            return int((cumulative > rng.rand() * cumulative[-1]).argmax())

        state = draw(start) if currstate is None else currstate
        states, rows = [], []
        for step in range(n_samples):
            state = draw(moves[state]) if step else state
            states.append(state)
            rows.append(self._generate_sample_from_state(state, random_state=rng))
        return np.atleast_2d(rows), np.array(states, dtype=int)

    def get_stationary_distribution(self):
        """Returns the stationary distribution of the states."""
        check_is_fitted(self, "transmat_")
        transmat = np.asarray(self.transmat_, dtype=float)
        n = len(transmat)
        # p (A - I) = 0 and Σ p = 1, by least squares, since one of the n + 1 equations is redundant.
        equations = np.vstack([transmat.T - np.eye(n), np.ones(n)])
        found = np.linalg.lstsq(equations, np.append(np.zeros(n), 1.0), rcond=None)[0]
        # Rounding may leave a transient state slightly below 0.
        found = np.maximum(found, 0)
        return found / found.sum()

    def aic(self, X, lengths=None):
        """Returns the Akaike information criterion; lower is better."""
        return -2 * self.score(X, lengths) + 2 * self._free_parameters()

    def bic(self, X, lengths=None):
        """Returns the Bayesian information criterion; lower is better."""
        return -2 * self.score(X, lengths) + self._free_parameters() * np.log(len(X))

    def _free_parameters(self):
        return sum(self._get_n_fit_scalars_per_param().values())

    # Learning.

    def fit(self, X, lengths=None):
        """Learns the parameters by Baum-Welch. Returns the estimator.

        Parameters
        ----------
        X : array, shape (n_samples, n_features)
            Observations of all sequences, one after another.
        lengths : array of int, optional
            Lengths of the sequences; one sequence if not given.
        """
        X = _rows(X)
        lengths = _lengths(X, lengths)
        self._init(X, lengths)
        self._check()
        monitor = self.monitor_
        monitor._reset()
        for _ in range(self.n_iter):
            stats, log_prob = self._do_estep(X, lengths)
            self._do_mstep(stats)
            monitor.report(self._compute_lower_bound(log_prob))
            if monitor.converged:
                break
        return self

    def _do_estep(self, X, lengths):
        stats = self._initialize_sufficient_statistics()
        logs = self._log_likelihoods(X)
        log_prob, posteriors, start, moves = self._by_model(_wayfix.expectations, logs, lengths)
        stats["nobs"] += np.count_nonzero(lengths)
        if "s" in self.params:
            stats["start"] += start
        if "t" in self.params:
            stats["trans"] += moves
        begin = 0
        for length in [len(X)] if self._may_add_all_at_once() else filter(None, lengths):
            rows = slice(begin, begin + length)
            self._accumulate_sufficient_statistics(
                stats, X[rows], logs[rows], posteriors[rows], None, None)
            begin += length
        return stats, log_prob

    def _may_add_all_at_once(self):
        # The flag counts only in the class that defines the method: a user's subclass that overrides the method
        # inherits the flag, but expects one sequence at a time, as in hmmlearn.
        name = "_accumulate_sufficient_statistics"
        owner = next(kind for kind in type(self).__mro__ if name in vars(kind))
        return vars(owner).get("_adds_all_at_once", False)

    def _initialize_sufficient_statistics(self):
        n = self.n_components
        return {"nobs": 0, "start": np.zeros(n), "trans": np.zeros((n, n))}

    def _accumulate_sufficient_statistics(
            self, stats, X, lattice, posteriors, fwdlattice, bwdlattice):
        """Adds the statistics of the observations of a sequence; those of the chain are added already.

        ``lattice`` has the log-likelihoods of all states at each step; ``fwdlattice`` and ``bwdlattice`` are None.
        """

    def _do_mstep(self, stats):
        # Probabilities of 0 are structure, and stay 0 whatever the prior would add.
        if "s" in self.params:
            start = np.where(self.startprob_ == 0, 0, self.startprob_prior - 1 + stats["start"])
            self.startprob_ = distributions(start, self.startprob_)
        if "t" in self.params:
            moves = np.where(self.transmat_ == 0, 0, self.transmat_prior - 1 + stats["trans"])
            self.transmat_ = distributions(moves, self.transmat_)

    def _compute_lower_bound(self, log_prob):
        return log_prob

    # What families override.

    def _init(self, X, lengths=None):
        self._check_and_set_n_features(X)
        rng, n = check_random_state(self.random_state), self.n_components
        if self._needs_init("s", "startprob_"):
            self.startprob_ = rng.dirichlet(np.full(n, 1 / n))
        if self._needs_init("t", "transmat_"):
            self.transmat_ = rng.dirichlet(np.full(n, 1 / n), size=n)
        counts = self._get_n_fit_scalars_per_param()
        if counts is not None:
            free = sum(counts[letter] for letter in self.params)
            if X.size < free:
                _log.warning("%d free parameters and %d numbers to learn them from: "
                             "expect a degenerate solution.", free, X.size)

    def _needs_init(self, letter, name):
        is_set = hasattr(self, name)
        if letter in self.init_params and is_set:
            _log.warning("%s is set, but will be overwritten, since init_params contains %r.",
                         name, letter)
        return letter in self.init_params or not is_set

    def _check_and_set_n_features(self, X):
        found = X.shape[1]
        if getattr(self, "n_features", found) != found:
            raise ValueError(f"X has {found} columns, expected {self.n_features}")
        self.n_features = found

    def _check(self):
        if self.implementation not in ("log", "scaling"):
            raise ValueError(f"implementation is {self.implementation!r}, "
                             "expected 'log' or 'scaling'")
        n = self.n_components
        self.startprob_ = np.asarray(self.startprob_)
        if self.startprob_.shape != (n,):
            raise ValueError(f"startprob_ has shape {self.startprob_.shape}, expected {(n,)}")
        self._check_sum_1("startprob_")
        self.transmat_ = np.asarray(self.transmat_)
        if self.transmat_.shape != (n, n):
            raise ValueError(f"transmat_ has shape {self.transmat_.shape}, expected {(n, n)}")
        self._check_sum_1("transmat_")

    def _check_sum_1(self, name):
        values = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
        if not _wayfix.are_distributions(np.atleast_2d(values)):
            raise ValueError(f"{name} must sum to 1, with no number below 0; "
                             f"found sums {values.sum(axis=-1)}, least {values.min()}")

    def _get_n_fit_scalars_per_param(self):
        raise NotImplementedError("a family returns the numbers of its parameters")

    def _compute_log_likelihood(self, X):
        # A family overrides one of the two methods; each calls the other, so neither would call both forever.
        if type(self)._compute_likelihood is BaseHMM._compute_likelihood:
            raise NotImplementedError("a family says how likely its observations are")
        with np.errstate(divide="ignore"):
            return np.log(self._compute_likelihood(X))

    def _compute_likelihood(self, X):
        if type(self)._compute_log_likelihood is BaseHMM._compute_log_likelihood:
            raise NotImplementedError("a family says how likely its observations are")
        with np.errstate(under="ignore"):
            return np.exp(self._compute_log_likelihood(X))

    def _generate_sample_from_state(self, state, random_state):
        return ()

    # Arrays for the compiled part.

    def _input(self, X, lengths):
        if not hasattr(self, "startprob_"):
            check_is_fitted(self, "startprob_")
        self._check()
        X = _rows(X)
        return X, _lengths(X, lengths)

    def _log_likelihoods(self, X):
        return np.ascontiguousarray(self._compute_log_likelihood(X), dtype=np.float64)

    def _call(self, function, X, lengths):
        return self._by_model(function, self._log_likelihoods(X), lengths)

    def _by_model(self, function, logs, lengths):
        start = np.ascontiguousarray(self.startprob_, dtype=np.float64)
        moves = np.ascontiguousarray(self.transmat_, dtype=np.float64)
        return function(start, moves, logs, lengths)


def _rows(X):
    """Returns a checked array of observations, without sklearn's checks if it is evidently valid."""
    # NaN and infinity survive in the sum; a finite sum has only finite terms. (A sum that overflows is only checked
    # once more.)
    if type(X) is np.ndarray and X.ndim == 2 and X.size and X.dtype.kind in "fiu":
        if X.dtype.kind != "f" or math.isfinite(X.sum(dtype=np.float64)):
            return X
    if np.ma.is_masked(X):
        raise ValueError("X has masked values, expected numbers")
    return check_array(X)


def _lengths(X, lengths):
    if lengths is None:
        return [len(X)]
    found = np.ravel(lengths)
    if found.dtype.kind not in "iuf" or (found < 0).any() or (found % 1 != 0).any():
        raise ValueError(f"lengths are {found}, expected integers from 0")
    found = found.astype(int)
    if found.sum() != len(X):
        raise ValueError(f"lengths sum to {found.sum()}, expected {len(X)}, the rows of X")
    return found.tolist()
