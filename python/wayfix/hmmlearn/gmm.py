"""Mixtures of Gaussians in each state."""

import logging

import numpy as np
from scipy import special
from sklearn.cluster import KMeans
from sklearn.utils import check_random_state

from .base import BaseHMM
from .gaussian import COVARIANCE_TYPES, covariance_of_all, log_densities
from .utils import fill_covars

_log = logging.getLogger(__name__)


class GMMHMM(BaseHMM):
    """Hidden Markov model of vectors with a mixture of Gaussians in each state.

    Parameters
    ----------
    n_mix : int
        Number of Gaussians in each state.
    min_covar : float
        Added to the initial variances.
    weights_prior : array or float
        Parameters of the Dirichlet priors of the weights.
    means_prior, means_weight : array or float
        Means of the Gaussian priors of the means, and their weights in observations.
    covars_prior, covars_weight : array or float, optional
        Parameters of the inverse gamma or inverse Wishart priors; no prior by default.
    covariance_type : {"spherical", "diag", "full", "tied"}
        For each Gaussian one variance, a variance for each column, or a matrix; or one matrix that the Gaussians of a
        state share.

    Attributes
    ----------
    weights_ : array, shape (n_components, n_mix)
        Weights of the Gaussians; letter w.
    means_ : array, shape (n_components, n_mix, n_features)
        Means; letter m.
    covars_ : array
        Covariances; letter c. The shape is (n_components, n_mix) for "spherical", followed by n_features once for
        "diag" and twice for "full"; for "tied" it is (n_components, n_features, n_features).
    """

    _adds_all_at_once = True

    _adds_all_at_once = True

    def __init__(self, n_components=1, n_mix=1, min_covar=1e-3, startprob_prior=1.0,
                 transmat_prior=1.0, weights_prior=1.0, means_prior=0.0, means_weight=0.0,
                 covars_prior=None, covars_weight=None, algorithm="viterbi",
                 covariance_type="diag", random_state=None, n_iter=10, tol=1e-2, verbose=False,
                 params="stmcw", init_params="stmcw", implementation="log"):
        super().__init__(
            n_components, startprob_prior, transmat_prior, algorithm, random_state, n_iter, tol,
            verbose, params, init_params, implementation)
        self.n_mix = n_mix
        self.min_covar = min_covar
        self.weights_prior = weights_prior
        self.means_prior = means_prior
        self.means_weight = means_weight
        self.covars_prior = covars_prior
        self.covars_weight = covars_weight
        self.covariance_type = covariance_type

    def _shape(self):
        n, m, d = self.n_components, self.n_mix, self.n_features
        shapes = {"spherical": (n, m), "diag": (n, m, d), "full": (n, m, d, d), "tied": (n, d, d)}
        if self.covariance_type not in COVARIANCE_TYPES:
            raise ValueError(f"covariance_type is {self.covariance_type!r}, "
                             f"expected one of {sorted(COVARIANCE_TYPES)}")
        return shapes[self.covariance_type]

    def _get_n_fit_scalars_per_param(self):
        n, m, d = self.n_components, self.n_mix, self.n_features
        of_matrix = d * (d + 1) // 2
        covars = {"spherical": n * m, "diag": n * m * d, "full": n * m * of_matrix,
                  "tied": n * of_matrix}
        return {"s": n - 1, "t": n * (n - 1), "m": n * m * d, "c": covars[self.covariance_type],
                "w": n * (m - 1)}

    def _init(self, X, lengths=None):
        super()._init(X, lengths)
        self._fill_priors()
        n, m = self.n_components, self.n_mix
        if self._needs_init("w", "weights_"):
            self.weights_ = np.full((n, m), 1 / m)
        if self._needs_init("m", "means_"):
            self.means_ = self._starts(X)
        if self._needs_init("c", "covars_"):
            of_all = covariance_of_all(X, self.min_covar)
            start = {"spherical": of_all.mean(), "diag": np.diag(of_all)}
            start = start.get(self.covariance_type, of_all)
            self.covars_ = np.broadcast_to(start, self._shape()).copy()

    def _starts(self, X):
        """Returns initial means: the centres of clusters within the cluster of each state."""
        X = np.asarray(X, dtype=float)
        clusters = KMeans(self.n_components, random_state=self.random_state, n_init=10)
        labels = clusters.fit_predict(X)
        rng = check_random_state(self.random_state)
        means = []
        for label in range(self.n_components):
            rows = X[labels == label]
            if len(rows) >= self.n_mix:
                parts = KMeans(self.n_mix, random_state=self.random_state, n_init=10).fit(rows)
                means.append(parts.cluster_centers_)
            else:
                # Too few rows to cluster: draws from a Gaussian about all of them.
                centre = clusters.cluster_centers_.mean(axis=0)
                of_all = covariance_of_all(X, self.min_covar)
                means.append(rng.multivariate_normal(centre, of_all, self.n_mix))
        return np.stack(means)

    def _fill_priors(self):
        """Gives each prior the shape of its parameters; the default priors change nothing."""
        n, m, d = self.n_components, self.n_mix, self.n_features
        kind = self.covariance_type
        # (prior, weight) for which the terms in `_maximize_covars` cancel: the estimate is then that of maximum
        # likelihood.
        flat = {"spherical": (-(d + 2) / 2, 0.0), "diag": (-1.5, 0.0), "full": (0.0, -(d + 2.0)),
                "tied": (0.0, -(m + d + 1.0))}
        weight = {"spherical": (n, m), "diag": (n, m, d), "full": (n, m), "tied": (n,)}
        shape = self._shape()
        if self.covars_prior is None:
            self.covars_prior = flat[kind][0]
        if self.covars_weight is None:
            self.covars_weight = flat[kind][1]
        for name, filled in [("weights_prior", (n, m)), ("means_prior", (n, m, d)),
                             ("means_weight", (n, m)), ("covars_prior", shape),
                             ("covars_weight", weight[kind])]:
            setattr(self, name, np.broadcast_to(getattr(self, name), filled).copy())

    def _check(self):
        super()._check()
        self.means_ = np.asarray(self.means_, dtype=float)
        if not hasattr(self, "n_features"):
            self.n_features = self.means_.shape[-1]
        self.weights_ = np.asarray(self.weights_, dtype=float)
        self.covars_ = np.asarray(self.covars_, dtype=float)
        n, m = self.n_components, self.n_mix
        for name, shape in [("weights_", (n, m)), ("means_", (n, m, self.n_features)),
                            ("covars_", self._shape())]:
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {shape}")
        self._check_sum_1("weights_")
        self._fill_priors()
        if self.covariance_type in ("spherical", "diag"):
            least = self.covars_.min()
        else:
            if not np.allclose(self.covars_, np.swapaxes(self.covars_, -1, -2)):
                raise ValueError("covariance matrices must be symmetric")
            least = np.linalg.eigvalsh(self.covars_).min()
            # Rounding may leave the least eigenvalue of a singular matrix below 0.
            least = 0 if -1e-12 * np.abs(self.covars_).max() < least < 0 else least
        if least < 0:
            raise ValueError("covariances must be positive definite")
        if least == 0:
            _log.warning("A covariance of the mixture is singular.")

    def _parts(self, X):
        """Returns log densities of all Gaussians plus their log weights; shape (n_samples, n_components, n_mix)."""
        n, m, d = self.n_components, self.n_mix, self.n_features
        covars, kind = self.covars_, self.covariance_type
        if kind == "tied":
            covars, kind = np.repeat(covars, m, axis=0), "full"
        covars = covars.reshape(n * m, *covars.shape[1 if self.covariance_type == "tied" else 2:])
        logs = log_densities(X, self.means_.reshape(n * m, d), covars, kind)
        with np.errstate(divide="ignore"):
            return logs.reshape(len(X), n, m) + np.log(self.weights_)

    def _compute_log_likelihood(self, X):
        return special.logsumexp(self._parts(X), axis=2)

    def _initialize_sufficient_statistics(self):
        stats = super()._initialize_sufficient_statistics()
        n, m, d = self.n_components, self.n_mix, self.n_features
        stats["post_mix_sum"] = np.zeros((n, m))
        stats["obs"] = np.zeros((n, m, d))
        # Sums of squares about the present means. The new means are near these, so that the shift in
        # `_maximize_covars` cancels few digits; sums about 0 might lose all of them.
        tail = {"spherical": (), "diag": (d,)}.get(self.covariance_type, (d, d))
        stats["about"] = np.zeros((n, m, *tail))
        return stats

    def _accumulate_sufficient_statistics(
            self, stats, X, lattice, posteriors, fwdlattice, bwdlattice):
        logs = self._parts(X)
        # The share of each Gaussian is w N(x) / Σ w N(x), and the denominator is the state's likelihood. Where that
        # is 0, the posterior is 0 too; the 0 for -inf avoids a NaN.
        finite = np.where(np.isfinite(lattice), lattice, 0)
        with np.errstate(under="ignore"):
            weights = np.exp(logs - finite[:, :, None]) * posteriors[:, :, None]
        stats["post_mix_sum"] += weights.sum(axis=0)
        stats["obs"] += np.einsum("tim,td->imd", weights, X)
        if "c" not in self.params:
            return
        for state in range(self.n_components):
            for part in range(self.n_mix):
                off, w = X - self.means_[state, part], weights[:, state, part]
                if self.covariance_type == "diag":
                    stats["about"][state, part] += w @ off**2
                elif self.covariance_type == "spherical":
                    stats["about"][state, part] += w @ (off**2).sum(axis=1)
                else:
                    stats["about"][state, part] += (off * w[:, None]).T @ off

    def _do_mstep(self, stats):
        super()._do_mstep(stats)
        shown, before = stats["post_mix_sum"], self.means_
        if "w" in self.params:
            weights = np.maximum(shown + self.weights_prior - 1, 0)
            sums = weights.sum(axis=1, keepdims=True)
            self.weights_ = np.where(sums > 0, weights / np.where(sums > 0, sums, 1), self.weights_)
        if "m" in self.params:
            lambdas = self.means_weight[:, :, None]
            total = shown[:, :, None] + lambdas
            sums = lambdas * self.means_prior + stats["obs"]
            self.means_ = np.where(total > 0, sums / np.where(total > 0, total, 1), before)
        if "c" in self.params:
            self._maximize_covars(stats, before)

    def _maximize_covars(self, stats, before):
        shown, d, kind = stats["post_mix_sum"], self.n_features, self.covariance_type
        # With δ = new - old mean: Σ γ (x - new)² = Σ γ (x - old)² - 2 δ Σ γ (x - old) + δ² Σ γ.
        moved = self.means_ - before
        first = stats["obs"] - shown[:, :, None] * before
        off = self.means_ - self.means_prior

        def product(a, b):
            if kind == "diag":
                return a * b
            if kind == "spherical":
                return (a * b).sum(axis=-1)
            return a[..., :, None] * b[..., None, :]

        def wide(weights):
            return weights.reshape(weights.shape + (1,) * (stats["about"].ndim - 2))

        sums = (stats["about"] - product(first, moved) - product(moved, first)
                + wide(shown) * product(moved, moved)
                + wide(self.means_weight) * product(off, off))
        prior, weight = self.covars_prior, self.covars_weight
        if kind == "full":
            sums, total = sums + np.swapaxes(prior, -1, -2), wide(shown + weight + d + 2)
        elif kind == "diag":
            sums, total = sums + 2 * weight, shown[:, :, None] + 2 * prior + 3
        elif kind == "spherical":
            sums, total = sums + 2 * weight, d * (shown + 1) + 2 * (prior + 1)
        else:
            sums = sums.sum(axis=1) + np.swapaxes(prior, -1, -2)
            total = (shown.sum(axis=1) + self.n_mix + weight + d + 1)[:, None, None]
        # A Gaussian without weight keeps its covariance.
        covars = np.where(total > 0, sums / np.where(total > 0, total, 1), self.covars_)
        if kind in ("spherical", "diag"):
            # The difference above may fall below 0 by rounding.
            covars = np.maximum(covars, 0)
        self.covars_ = covars

    def _generate_sample_from_state(self, state, random_state):
        weights = self.weights_[state]
        part = random_state.choice(self.n_mix, p=weights / weights.sum())
        if self.covariance_type == "tied":
            matrix = self.covars_[state]
        else:
            covars = self.covars_[state, part][None]
            matrix = fill_covars(covars, self.covariance_type, 1, self.n_features)[0]
        return random_state.multivariate_normal(self.means_[state, part], matrix)
