"""Many sequences, smoothed: at once by numpy and dynamax, one by one by hmmlearn."""

from functools import partial

import jax
import numpy as np
from libraries import smooth_by_dynamax, smooth_by_hmmlearn
from models import Case, of_distributions, of_numbers, worst
from race import Contender

NAME = "road map 2000 x 50"
# Numbers of sequences that numpy multiplies together: all, and as many as fit into the caches.
ALL, FEWER = 2000, 250
# Number of sequences for hmmlearn, enough to measure the time per step.
FEW = 100


def run(times, out):
    """Compares and times all three."""
    case = Case(out, NAME)
    steps, sequences = case.sizes["steps"], case.sizes["sequences"]
    prior, rows, likelihoods = case["prior"], case.rows, case["likelihoods"]

    def check(count, answer):
        logs, smoothed = answer
        smoothed = np.asarray(smoothed)
        return worst(
            of_numbers(logs, case["log_likelihoods"][:count]),
            of_distributions(smoothed[:, 0], case["smoothed_first"][:count]),
            of_distributions(smoothed.sum(axis=1), case["smoothed_sum"][:count]))

    matrix = case.sparse.toarray()
    transposed = np.ascontiguousarray(matrix.T)

    def numpy(together):
        blocks = [np.ascontiguousarray(likelihoods[start:start + together].transpose(1, 2, 0))
                  for start in range(0, sequences, together)]

        def work():
            return [smooth_block(prior, matrix, transposed, block) for block in blocks]

        def check_blocks(answer):
            logs = np.concatenate([logs for logs, _ in answer])
            smoothed = np.concatenate([block.transpose(2, 0, 1) for _, block in answer])
            return check(sequences, (logs, smoothed))

        return Contender(work, steps * sequences, check_blocks)

    all_at_once = jax.jit(jax.vmap(smooth_by_dynamax, (None, None, 0)))
    given = [jax.device_put(array) for array in (prior, rows, case.logs())]

    def by_dynamax():
        return jax.block_until_ready(all_at_once(*given))

    def by_hmmlearn():
        return [smooth_by_hmmlearn(prior, rows, one) for one in likelihoods[:FEW]]

    times.race(NAME, "smooth", {
        f"numpy (GEMM, {ALL} at once)": numpy(ALL),
        f"numpy (GEMM, {FEWER} at once)": numpy(FEWER),
        "dynamax (vmap)": Contender(by_dynamax, steps * sequences, partial(check, sequences)),
        "hmmlearn": Contender(
            by_hmmlearn, steps * FEW,
            lambda answer: check(FEW, [np.stack(part) for part in zip(*answer)])),
    })


def smooth_block(prior, matrix, transposed, likelihoods):
    """Smooths sequences of one length; the arrays have axes (steps, states, sequences)."""
    smoothed = np.empty_like(likelihoods)
    scales = np.empty((likelihoods.shape[0], 1, likelihoods.shape[2]))
    for step, likelihood in enumerate(likelihoods):
        x = smoothed[step]
        if step:
            np.matmul(matrix, smoothed[step - 1], out=x)
            x *= likelihood
        else:
            np.multiply(prior[:, None], likelihood, out=x)
        np.sum(x, axis=0, keepdims=True, out=scales[step])
        np.reciprocal(scales[step], out=scales[step])
        x *= scales[step]
    beta, weighted = np.ones_like(likelihoods[0]), np.empty_like(likelihoods[0])
    for step in range(len(likelihoods) - 1, 0, -1):
        np.multiply(beta, likelihoods[step], out=weighted)
        weighted *= scales[step]
        np.matmul(transposed, weighted, out=beta)
        smoothed[step - 1] *= beta
    return -np.log(scales).sum(axis=(0, 1)), smoothed
