"""Arrays of probabilities and covariances."""

import numpy as np


def normalize(a, axis=None):
    """Divides an array by its sum, or its sums along an axis, in place; sums of 0 stay."""
    sums = np.asarray(a.sum(axis, keepdims=axis is not None))
    if axis is not None:
        sums[sums == 0] = 1
    a /= sums


def fill_covars(covars, covariance_type="full", n_components=1, n_features=1):
    """Returns covariance matrices, one for each state, from any of the four forms."""
    covars = np.asarray(covars)
    if covariance_type == "full":
        return covars
    if covariance_type == "tied":
        return np.tile(covars, (n_components, 1, 1))
    if covariance_type == "diag":
        return np.stack([np.diag(variances) for variances in covars])
    return np.ravel(covars)[:, None, None] * np.eye(n_features)


def check_covars(covars, covariance_type, n_components):
    """Raises ValueError unless covariances have the shape of their type, and are valid."""
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
        return
    for matrix in [covars] if covariance_type == "tied" else covars:
        if matrix.shape[0] != matrix.shape[1]:
            raise ValueError(f"a covariance matrix has shape {matrix.shape}")
        if not np.allclose(matrix, matrix.T) or (np.linalg.eigvalsh(matrix) <= 0).any():
            raise ValueError("covariance matrices must be symmetric and positive definite")
