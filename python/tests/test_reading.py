"""Learned parameters can be read, results can be pickled, and families take matrices."""

import pickle

import numpy as np
import pytest
import scipy.sparse
import scipy.stats
import wayfix
from wayfix.learning import Family, learn
from wayfix.recognition import Recognizer

START, MOVES, TABLE = [0.4, 0.6], [[0.9, 0.1], [0.25, 0.75]], [[0.8, 0.2], [0.1, 0.9]]


def pickled(value):
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize("before", [False, True])
def test_parameters_of_a_model(before):
    hmm = wayfix.Hmm(START, MOVES, table=TABLE, start_before_move=before)
    np.testing.assert_array_equal(hmm.start, START)
    np.testing.assert_array_equal(hmm.moves, MOVES)
    np.testing.assert_array_equal(hmm.table, TABLE)
    assert (hmm.start_before_move, hmm.logarithms, hmm.states) == (before, False, 2)
    assert repr(hmm) == "<Hmm: 2 states, dense moves, a table of 2 symbols>"


def test_parameters_of_a_sparse_model():
    hmm = wayfix.Hmm(START, scipy.sparse.csr_array([[0.9, 0.1], [0, 1]]), logarithms=True)
    rows, columns, p = hmm.moves
    np.testing.assert_array_equal(scipy.sparse.coo_array((p, (rows, columns))).toarray(), [[0.9, 0.1], [0, 1]])
    assert hmm.table is None and repr(hmm) == "<Hmm: 2 states, 3 moves, log-likelihoods>"
    assert wayfix.Hmm(hmm.start, hmm.moves, logarithms=True).score(np.zeros((3, 2))) == pytest.approx(0)


def test_what_was_learned():
    rng = np.random.default_rng(0)
    sequences = [rng.integers(0, 2, 50) for _ in range(3)]
    learned = learn(wayfix.Hmm(START, MOVES, table=TABLE), sequences, iterations=3)
    assert learned.hmm.moves.sum(axis=1) == pytest.approx([1, 1])
    assert learned.hmm.table.shape == (2, 2) and (learned.hmm.table != TABLE).all()
    again = pickled(learned)
    np.testing.assert_array_equal(again.hmm.table, learned.hmm.table)
    np.testing.assert_array_equal(again.objectives, learned.objectives)
    names = ("family", "log_likelihood", "converged", "stopped", "cause", "left_out", "aic", "bic", "iterations")
    assert [getattr(again, name) for name in names] == [getattr(learned, name) for name in names]


def test_answers_and_beliefs_are_pickled():
    recognizer = Recognizer(np.eye(20), closed=True, off_map=True)
    answer = recognizer.track().step(np.eye(20)[3])
    assert pickled(answer) == answer
    beliefs = recognizer.recording(np.eye(20)[2:9]).smoothed()
    again = pickled(beliefs)
    for name in ("probabilities", "places", "probability", "around", "off_map", "log_likelihoods"):
        np.testing.assert_array_equal(getattr(again, name), getattr(beliefs, name))
    at = np.full(7, 19)
    np.testing.assert_array_equal(again.mass_near(at, 3), beliefs.mass_near(at, 3))
    np.testing.assert_array_equal(again.credible_set(2, 0.9), beliefs.credible_set(2, 0.9))


A, B = np.array([[2.0, 0.5], [0.5, 1.0]]), np.eye(2)
MEANS = np.array([[0.0, 0.0], [1.0, 2.0]])
GAUSSIANS = {
    "spherical": ([2.0, 3.0], [2 * B, 3 * B]),
    "diag": ([[1.0, 2.0], [3.0, 4.0]], [np.diag([1.0, 2.0]), np.diag([3.0, 4.0])]),
    "diagonal": ([[1.0, 2.0], [3.0, 4.0]], [np.diag([1.0, 2.0]), np.diag([3.0, 4.0])]),
    "full": ([A, B], [A, B]),
    "tied": (A, [A, A]),
}


@pytest.mark.parametrize("kind", GAUSSIANS)
def test_covariances_are_matrices(kind):
    given, full = GAUSSIANS[kind]
    rows = np.random.default_rng(1).normal(size=(5, 2))
    family = Family("gaussian", covariance_type=kind, means=MEANS, covariances=given)
    expected = np.stack([scipy.stats.multivariate_normal(MEANS[i], full[i]).logpdf(rows) for i in (0, 1)], axis=1)
    np.testing.assert_allclose(family.log_likelihoods(rows), expected)
    np.testing.assert_array_equal(family.parameters["covariances"], given)
    np.testing.assert_array_equal(pickled(family).log_likelihoods(rows), family.log_likelihoods(rows))
    student = Family("student_t", scale_type=kind, degrees=[3.0, 5.0], means=MEANS, scales=given)
    expected = [scipy.stats.multivariate_t(MEANS[i], full[i], df=(3, 5)[i]).logpdf(rows) for i in (0, 1)]
    np.testing.assert_allclose(student.log_likelihoods(rows), np.stack(expected, axis=1))
    np.testing.assert_array_equal(student.parameters["scales"], given)
    # One state with the two as its parts.
    given = [given]
    mixture = Family("gaussian_mixture", covariance_type=kind, weights=[[0.5, 0.5]], means=[MEANS], covariances=given)
    parts = np.stack([scipy.stats.multivariate_normal(MEANS[i], full[i]).pdf(rows) for i in (0, 1)])
    np.testing.assert_allclose(mixture.log_likelihoods(rows)[:, 0], np.log(parts.mean(axis=0)))
    np.testing.assert_array_equal(mixture.parameters["covariances"], given)


def test_covariances_of_a_regression():
    given = dict(coefficients=[[1.0, 2.0]], intercepts=[[0.0, 1.0]], covariances=[A], full=True)
    family = Family("linear_regression", **given)
    np.testing.assert_array_equal(family.parameters["covariances"], [A])
    rows = np.array([[2.0, 0.3, 0.4]])
    expected = scipy.stats.multivariate_normal([2.0, 5.0], A).logpdf(rows[0, 1:])
    assert family.log_likelihoods(rows)[0, 0] == pytest.approx(expected)


@pytest.mark.parametrize("kind, given", [
    ("full", [[1.0, 0.0, 0.0, 1.0]] * 2), ("full", [[[1.0, 0.0]]] * 2), ("tied", [A, B]), ("spherical", [[1.0], [1.0]]),
    ("full", 3),
])
def test_covariances_of_other_shapes(kind, given):
    with pytest.raises(wayfix.Error, match="covariances"):
        Family("gaussian", covariance_type=kind, means=MEANS, covariances=given)


def test_the_table_of_families():
    kinds = str(pytest.raises(wayfix.Error, Family, "none").value).split("expected ")[1].split(", ")
    for kind in kinds:
        if kind.startswith(("zero_inflated_", "hurdle_")):
            continue
        assert f"\n{kind} " in Family.__doc__, kind
