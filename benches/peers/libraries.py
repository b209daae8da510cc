"""Each library's routines for given likelihoods, under wayfix's names.

What a library takes besides (logarithms, rows for columns, its own array) is
made before anything is timed.
"""

import jax
import numpy as np
from dynamax.hidden_markov_model.inference import hmm_filter, hmm_posterior_mode, hmm_smoother
from hmmlearn import _hmmc


def of_hmmlearn(case):
    """The compiled routines that hmmlearn's own methods call."""
    prior, rows, likelihoods, logs = case["prior"], case.rows, case["likelihoods"], case.logs()

    def forward():
        return _hmmc.forward_scaling(prior, rows, likelihoods)[:2]

    return {
        "forward": forward,
        "score": lambda: forward()[0],
        "smooth": lambda: smooth_by_hmmlearn(prior, rows, likelihoods),
        "viterbi": lambda: _hmmc.viterbi(prior, rows, logs)[1],
    }


def smooth_by_hmmlearn(prior, rows, likelihoods):
    """Log-likelihood and posteriors."""
    log, forward, scaling = _hmmc.forward_scaling(prior, rows, likelihoods)
    posteriors = forward * _hmmc.backward_scaling(prior, rows, likelihoods, scaling)
    posteriors /= posteriors.sum(axis=1, keepdims=True)
    return log, posteriors


def of_dynamax(case):
    """Compiled once; values that are not returned are not computed."""
    given = [jax.device_put(array) for array in (case["prior"], case.rows, case.logs())]

    def compiled(routine):
        routine = jax.jit(routine)
        return lambda: jax.block_until_ready(routine(*given))

    def forward(*given):
        posterior = hmm_filter(*given)
        return posterior.marginal_loglik, posterior.filtered_probs

    return {
        "forward": compiled(forward),
        "score": compiled(lambda *given: hmm_filter(*given).marginal_loglik),
        "smooth": compiled(smooth_by_dynamax),
        "viterbi": compiled(hmm_posterior_mode),
    }


def smooth_by_dynamax(prior, rows, logs):
    """Log-likelihood and posteriors."""
    posterior = hmm_smoother(prior, rows, logs)
    return posterior.marginal_loglik, posterior.smoothed_probs


def of_scipy(case):
    """Loops over products of a CSR matrix and a vector."""
    prior, likelihoods, steps = case["prior"], case["likelihoods"], len(case["likelihoods"])
    matrix, transposed = case.sparse, case.sparse.T.tocsr()
    factors = np.empty(steps)

    def advance(step, x):
        x = matrix @ x if step else prior.copy()
        x *= likelihoods[step]
        factors[step] = factor = x.sum()
        x /= factor
        return x

    def stream():
        x = None
        for step in range(steps):
            x = advance(step, x)
        return np.log(factors).sum(), x

    def forward():
        filtered = np.empty_like(likelihoods)
        x = None
        for step in range(steps):
            filtered[step] = x = advance(step, x)
        return np.log(factors).sum(), filtered

    def smooth():
        log, smoothed = forward()
        beta = np.ones(case.states)
        for step in range(steps - 1, 0, -1):
            beta *= likelihoods[step]
            beta /= factors[step]
            beta = transposed @ beta
            smoothed[step - 1] *= beta
        return log, smoothed

    return {"filter": stream, "forward": forward, "smooth": smooth}
