"""Gaussian observations, with four kinds of covariances."""

import numpy as np
from sklearn.cluster import KMeans

from .. import _wayfix
from .base import BaseHMM
from .utils import check_covars, fill_covars

COVARIANCE_TYPES = frozenset(("spherical", "diag", "full", "tied"))
#: Smallest variance for which a density is computed.
_LEAST = np.finfo(float).tiny
#: Added to the diagonal of a matrix that is singular up to rounding.
_RIDGE = 1e-7


def log_densities(X, means, covars, covariance_type):
    """Returns log densities, shape (n_samples, len(means)), of Gaussians with these means.

    ``covars`` has a variance, a row of variances or a matrix for each mean, or one matrix if tied.
    """
    covars = np.asarray(covars, dtype=np.float64)
    n, d = np.shape(means)
    if covariance_type == "tied":
        covars = np.broadcast_to(covars, (n, *covars.shape[-2:]))
    rows = np.ascontiguousarray(X, dtype=np.float64)
    means = np.ascontiguousarray(means, dtype=np.float64)
    if covariance_type in ("spherical", "diag"):
        covars = np.maximum(covars, _LEAST)
        if covariance_type == "spherical":
            covars = np.repeat(covars, d).reshape(n, d)
        return _wayfix.diagonal_log_densities(rows, means, np.ascontiguousarray(covars))
    try:
        return _wayfix.gaussian_log_densities(rows, means, covars.reshape(n, -1))
    except _wayfix.Error:
        # A state with too few observations has a singular covariance. hmmlearn adds the same ridge; so the state
        # keeps a density, and may gain observations again.
        least = np.linalg.eigvalsh(covars)[:, :1, None]
        largest = np.abs(covars).max(axis=(1, 2), keepdims=True)
        covars = covars + _RIDGE * (least <= 1e-12 * largest) * np.eye(covars.shape[-1])
        return _wayfix.gaussian_log_densities(rows, means, covars.reshape(n, -1))


def covariance_of_all(X, least):
    """Returns the covariance of all rows, with ``least`` added to its diagonal."""
    count, d = X.shape
    if count < 2:
        raise ValueError(f"X has {count} sample, expected at least 2 to start covariances from")
    return np.cov(X.T).reshape(d, d) + least * np.eye(d)


class GaussianHMM(BaseHMM):
    """Hidden Markov model with a Gaussian distribution of vectors in each state.

    Parameters
    ----------
    covariance_type : {"spherical", "diag", "full", "tied"}
        For each state one variance, a variance for each column, or a matrix; or one matrix for all states.
    min_covar : float
        Added to the initial variances.
    means_prior, means_weight : array or float
        Mean of the Gaussian prior of the means, and its weight in observations.
    covars_prior, covars_weight : array or float
        Parameters of the inverse gamma or inverse Wishart prior of the covariances.

    Attributes
    ----------
    means_ : array, shape (n_components, n_features)
        Means; letter m.
    covars_ : array, shape (n_components, n_features, n_features)
        Covariance matrices of all states; set in the shape of ``covariance_type``; letter c.
    """

    _adds_all_at_once = True

    def __init__(self, n_components=1, covariance_type="diag", min_covar=1e-3,
                 startprob_prior=1.0, transmat_prior=1.0, means_prior=0, means_weight=0,
                 covars_prior=1e-2, covars_weight=1, algorithm="viterbi", random_state=None,
                 n_iter=10, tol=1e-2, verbose=False, params="stmc", init_params="stmc",
                 implementation="log"):
        super().__init__(
            n_components, startprob_prior, transmat_prior, algorithm, random_state, n_iter, tol,
            verbose, params, init_params, implementation)
        self.covariance_type = covariance_type
        self.min_covar = min_covar
        self.means_prior = means_prior
        self.means_weight = means_weight
        self.covars_prior = covars_prior
        self.covars_weight = covars_weight

    @property
    def covars_(self):
        """Covariance matrices of all states."""
        return fill_covars(self._covars_, self.covariance_type, self.n_components, self.n_features)

    @covars_.setter
    def covars_(self, covars):
        covars = np.array(covars, dtype=float)
        if self.covariance_type == "spherical" and covars.ndim > 2:
            covars = covars.reshape(len(covars), -1)
        check_covars(covars, self.covariance_type, self.n_components)
        self._covars_ = covars

    def _get_n_fit_scalars_per_param(self):
        n, d = self.n_components, self.n_features
        of_matrix = d * (d + 1) // 2
        covars = {"spherical": n, "diag": n * d, "full": n * of_matrix, "tied": of_matrix}
        return {"s": n - 1, "t": n * (n - 1), "m": n * d, "c": covars[self.covariance_type]}

    def _init(self, X, lengths=None):
        super()._init(X, lengths)
        n, d = self.n_components, X.shape[1]
        if self._needs_init("m", "means_"):
            clusters = KMeans(n, random_state=self.random_state, n_init=10)
            self.means_ = clusters.fit(np.asarray(X, dtype=float)).cluster_centers_
        if self._needs_init("c", "covars_"):
            of_all = covariance_of_all(X, self.min_covar)
            self.covars_ = {
                "spherical": lambda: np.full((n, d), of_all.mean()),
                "diag": lambda: np.tile(np.diag(of_all), (n, 1)),
                "full": lambda: np.tile(of_all, (n, 1, 1)),
                "tied": lambda: of_all,
            }[self.covariance_type]()

    def _check(self):
        super()._check()
        if self.covariance_type not in COVARIANCE_TYPES:
            raise ValueError(f"covariance_type is {self.covariance_type!r}, "
                             f"expected one of {sorted(COVARIANCE_TYPES)}")
        self.means_ = np.asarray(self.means_)
        n, d = self.n_components, self.means_.shape[-1]
        if self.means_.shape != (n, d):
            raise ValueError(f"means_ has shape {self.means_.shape}, expected ({n}, columns)")
        self.n_features = d
        shapes = {"spherical": [(n,), (n, 1), (n, d)], "diag": [(n, d)], "full": [(n, d, d)],
                  "tied": [(d, d)]}[self.covariance_type]
        if self._covars_.shape not in shapes:
            raise ValueError(f"covars_ has shape {self._covars_.shape}, expected {shapes[0]}")

    def _compute_log_likelihood(self, X):
        covars = self._covars_
        if self.covariance_type == "spherical":
            # A variance for each state, or a row of equal ones.
            covars = covars.reshape(self.n_components, -1)[:, 0]
        return log_densities(X, self.means_, covars, self.covariance_type)

    def _initialize_sufficient_statistics(self):
        stats = super()._initialize_sufficient_statistics()
        n, d = self.n_components, self.n_features
        stats["post"] = np.zeros(n)
        stats["obs"] = np.zeros((n, d))
        stats["obs**2"] = np.zeros((n, d))
        stats["obs*obs.T"] = np.zeros((n, d, d))
        return stats

    def _accumulate_sufficient_statistics(
            self, stats, X, lattice, posteriors, fwdlattice, bwdlattice):
        if "m" in self.params or "c" in self.params:
            stats["post"] += posteriors.sum(axis=0)
            stats["obs"] += posteriors.T @ X
        if "c" not in self.params:
            return
        if self.covariance_type in ("spherical", "diag"):
            # In doubles, since squares of narrow integers would overflow.
            stats["obs**2"] += posteriors.T @ np.square(X, dtype=np.float64)
            return
        for state, weights in enumerate(posteriors.T):
            stats["obs*obs.T"][state] += (X * weights[:, None]).T @ X

    def _do_mstep(self, stats):
        super()._do_mstep(stats)
        weights = stats["post"][:, None]
        if "m" in self.params:
            shown = self.means_weight + weights
            sums = self.means_weight * self.means_prior + stats["obs"]
            self.means_ = np.where(shown > 0, sums / np.where(shown > 0, shown, 1), self.means_)
        if "c" not in self.params:
            return
        # hmmlearn's update under its normal inverse gamma (or inverse Wishart) prior.
        # Sums of squares are about the new means: Σ γ (x - μ)² = Σ γ x² - 2 μ Σ γ x + μ² Σ γ.
        means, off = self.means_, self.means_ - self.means_prior
        if self.covariance_type in ("spherical", "diag"):
            sums = (self.means_weight * off**2 + stats["obs**2"] - 2 * means * stats["obs"]
                    + means**2 * weights)
            shown = max(self.covars_weight - 1, 0) + weights
            self._covars_ = (self.covars_prior + sums) / np.maximum(shown, 1e-5)
            if self.covariance_type == "spherical":
                mean = self._covars_.mean(axis=1, keepdims=True)
                self._covars_ = np.tile(mean, (1, self.n_features))
            return

        def outer(a, b):
            return a[:, :, None] * b[:, None, :]

        cross = outer(stats["obs"], means)
        sums = (self.means_weight * outer(off, off) + stats["obs*obs.T"] - cross
                - cross.transpose(0, 2, 1) + outer(means, means) * weights[:, :, None])
        more = max(self.covars_weight - self.n_features, 0)
        if self.covariance_type == "tied":
            self._covars_ = (self.covars_prior + sums.sum(axis=0)) / (more + weights.sum())
        else:
            shown = more + weights[:, :, None]
            self._covars_ = (self.covars_prior + sums) / np.maximum(shown, 1e-5)

    def _generate_sample_from_state(self, state, random_state):
        return random_state.multivariate_normal(self.means_[state], self.covars_[state])
