"""Arrays of probabilities and covariances."""

import numpy as np


def normalize(a, axis=None):
    """Divides an array in place by its sum, or by its sums along an axis, where a sum of 0 leaves zeros."""
    sums = np.asarray(a.sum(axis, keepdims=axis is not None))
    if axis is not None:
        sums[sums == 0] = 1
    a /= sums


def distributions(weights, before):
    """Returns weights divided by the sums of their rows, with 0 for negative ones.

    A row without a positive weight is that of ``before``.
    """
    # The mode of a Dirichlet posterior: a prior below one may make a weight negative, and the mode is then at 0.
    weights = np.maximum(weights, 0)
    sums = weights.sum(axis=-1, keepdims=True)
    return np.where(sums > 0, weights / np.where(sums > 0, sums, 1), before)


def fill_covars(covars, covariance_type="full", n_components=1, n_features=1):
    """Returns covariance matrices, one for each state, from any of the four forms."""
    covars = np.asarray(covars)
    if covariance_type == "full":
        return covars
    if covariance_type == "tied":
        return np.tile(covars, (n_components, 1, 1))
    if covariance_type == "diag":
        return np.stack([np.diag(variances) for variances in covars])
    # A variance for each state, or a row of equal ones, as hmmlearn keeps them.
    return covars.reshape(len(covars), -1)[:, 0, None, None] * np.eye(n_features)


def check_covars(covars, covariance_type, n_components):
    """Raises ValueError unless covariances have the shape of their type and are positive definite."""
    shapes = {"spherical": 1, "diag": 2, "tied": 2, "full": 3}
    if covariance_type not in shapes:
        raise ValueError(f"covariance_type is {covariance_type!r}, expected one of {sorted(shapes)}")
    covars = np.asarray(covars)
    if covariance_type != "spherical" and covars.ndim != shapes[covariance_type]:
        raise ValueError(f"covariances {covariance_type!r} have {covars.ndim} axes, "
                         f"expected {shapes[covariance_type]}")
    if covariance_type != "tied" and len(covars) != n_components:
        raise ValueError(f"covariances of {len(covars)} states, expected {n_components}")
    if covariance_type in ("spherical", "diag"):
        if not (covars > 0).all():
            raise ValueError("variances must be above 0")
        if covariance_type == "spherical" and (covars.T != covars.reshape(len(covars), -1)[:, 0]).any():
            raise ValueError("spherical variances must be the same for each column")
        return
    for matrix in [covars] if covariance_type == "tied" else covars:
        if matrix.shape[0] != matrix.shape[1]:
            raise ValueError(f"a covariance matrix has shape {matrix.shape}")
        if not np.allclose(matrix, matrix.T) or (np.linalg.eigvalsh(matrix) <= 0).any():
            raise ValueError("covariance matrices must be symmetric and positive definite")
