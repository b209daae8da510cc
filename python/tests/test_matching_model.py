"""The matcher against plain models in numpy, where its documentation leaves nothing open but two numbers.

Roads are parallel and not connected, so that moves weigh the same on each and cancel; what is left is the
position across, with errors that are white or last, of a receiver in usual, poor or rough reception. The
share of rough receivers (0.05) and how much of their errors lasts (at most 0.7) are constants of the
library. Not covered: lengths, detours, turns, outliers and the way off the road, whose constants are its own.
"""

import numpy as np
import pytest
from wayfix.matching import Matcher, RoadNetwork

DEGREE = np.pi / 180 * 6_371_008.8
ROADS = np.array([0.0, 12.0, 22.0])
SIGMA, ROUGH = 5.0, 0.05
FACTORS = {"usual": 1.0, "poor": 4.0, "rough": 2.0}
#: All that would let a vehicle do something else.
NOTHING_ELSE = dict(noise=SIGMA, outliers=1e-12, leave_road=1e-12, stop=1e-9)


@pytest.fixture(scope="module")
def network():
    """One-way roads to the east, 6 km long, at these distances in metres north of the equator."""
    ids = np.arange(2 * len(ROADS))
    nodes = {"node": ids, "lat": np.repeat(ROADS, 2) / DEGREE, "lon": np.tile([-3000, 3000], len(ROADS)) / DEGREE}
    return RoadNetwork(nodes, {"from": ids[::2], "to": ids[1::2]})


def probabilities(network, across, every=10.0, points=None, **model):
    """Probabilities of the roads at the last point."""
    time = every * np.arange(len(across))
    columns = {"time": time, "lat": across / DEGREE, "lon": (15 * time - 500) / DEGREE}
    drive = Matcher(network, **NOTHING_ELSE | model).match_drive(columns | (points or {}))
    edges, p = drive.edges(len(across) - 1)
    return np.array([p[edges == road].sum() for road in range(len(ROADS))])


def normal(x, sigma):
    return np.exp(-0.5 * (x / sigma) ** 2) / sigma


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("poor", [1e-9, 0.2])
def test_one_point(network, seed, poor):
    """A mixture of three normal densities for each road, and Bayes."""
    y = np.random.default_rng(seed).normal(8, 8, 1)
    shares = {"usual": (1 - ROUGH) * (1 - poor), "poor": (1 - ROUGH) * poor, "rough": ROUGH}
    for sigma, columns in ((SIGMA, {}), (9.0, {"accuracy": np.array([9.0])})):
        density = sum(shares[kind] * normal(y - ROADS, factor * sigma) for kind, factor in FACTORS.items())
        found = probabilities(network, y, points=columns, poor=poor)
        np.testing.assert_allclose(found, density / density.sum(), rtol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_white_errors(network, seed):
    """The forward pass of a hidden Markov model of six states: a road, and a receiver that is rough or not and is
    exchanged once an hour."""
    y = np.random.default_rng(seed).normal(6, 5, 6)
    sigma = np.array([SIGMA, 2 * SIGMA])
    share = np.array([1 - ROUGH, ROUGH])
    stays = np.exp(-10 / 3600)
    moves = stays * np.eye(2) + (1 - stays) * share
    belief = np.tile(share, (len(ROADS), 1))
    for k, at in enumerate(y):
        belief = (belief if k == 0 else belief @ moves) * normal(at - ROADS[:, None], sigma)
        belief /= belief.sum()
    found = probabilities(network, y, lasting=0.0, poor=1e-9)
    # Distances along the road say something about the reception, too: 0.0105 at most here.
    np.testing.assert_allclose(found, belief.sum(axis=1), atol=0.02)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("lasting", "lasts"), [(0.5, 20.0), (0.9, 20.0), (0.995, 60.0)])
def test_errors_that_last(network, seed, lasting, lasts):
    """Joint normal densities of all points, for a receiver that does not change."""
    rng = np.random.default_rng(seed)
    time = 10.0 * np.arange(6)
    decay = np.exp(-np.abs(time[:, None] - time) / lasts)

    def covariance(sigma, share):
        return sigma**2 * (share * decay + (1 - share) * np.eye(len(time)))

    y = 6 + rng.multivariate_normal(np.zeros(6), covariance(SIGMA, lasting))
    density = np.zeros(len(ROADS))
    for weight, matrix in ((1 - ROUGH, covariance(SIGMA, lasting)), (ROUGH, covariance(2 * SIGMA, min(lasting, 0.7)))):
        off = y - ROADS[:, None]
        squares = np.einsum("ri,ij,rj->r", off, np.linalg.inv(matrix), off)
        density += weight * np.exp(-0.5 * squares) / np.sqrt(np.linalg.det(matrix))
    found = probabilities(network, y, lasting=lasting, lasts=lasts, poor=1e-9)
    # 0.0015 at most here.
    np.testing.assert_allclose(found, density / density.sum(), atol=0.003)
