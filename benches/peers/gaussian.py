"""Baum-Welch with Gaussian vectors by hmmlearn and dynamax."""

import math
from functools import partial

import jax
import numpy as np
from dynamax.hidden_markov_model import GaussianHMM as DynamaxGaussian
from hmmlearn.hmm import GaussianHMM as HmmlearnGaussian
from models import Case, of_numbers, of_paths, worst
from race import elapsed, within

NAME = "gaussian"


def run(times, out):
    """Compares all re-estimations, what they end at and its paths, and times one."""
    case = Case(out, NAME)
    more, rows = case.sizes["more"], case["rows"]
    states, components = case["means"].shape
    steps = rows.shape[0] * rows.shape[1]

    def check(who, logs, means, covariances):
        scale = np.abs(case["learned_covariances"]).max()
        off = worst(of_numbers(logs, case.sizes["log_likelihoods"][:len(logs)]),
                    np.abs(means - case["learned_means"]).max(),
                    np.abs(covariances - case["learned_covariances"]).max() / scale)
        return within(f"{NAME}, {who}", off)

    together, lengths = rows.reshape(steps, -1), [rows.shape[1]] * len(rows)

    def fit(iterations):
        # Without a prior.
        hmm = HmmlearnGaussian(
            states, "full", n_iter=iterations, tol=-math.inf, init_params="", covars_prior=0,
            implementation="scaling")
        hmm.startprob_, hmm.transmat_ = case["prior"].copy(), case.rows
        hmm.n_features = components
        hmm.means_, hmm.covars_ = case["means"].copy(), case["covariances"].copy()
        return hmm.fit(together, lengths)

    hmm = fit(1 + more)
    off_hmmlearn = check("hmmlearn", list(hmm.monitor_.history), hmm.means_, hmm.covars_)
    path = hmm.predict(together, lengths)
    within(f"{NAME}, hmmlearn, path", of_paths(path, case["paths"].reshape(-1)))

    # The mode of the posterior is the maximum of the likelihood.
    hmm = DynamaxGaussian(
        states, components, initial_probs_concentration=1.0,
        transition_matrix_concentration=1.0, emission_prior_concentration=0.0,
        emission_prior_scale=0.0, emission_prior_extra_df=-2.0 * components - 2.0)
    params, props = hmm.initialize(
        jax.random.PRNGKey(0), method="kmeans", emissions=jax.numpy.asarray(rows[0]),
        initial_probs=jax.numpy.asarray(case["prior"]),
        transition_matrix=jax.numpy.asarray(case.rows),
        emission_means=jax.numpy.asarray(case["means"]),
        emission_covariances=jax.numpy.asarray(case["covariances"]))
    emissions = jax.numpy.asarray(rows)

    @jax.jit
    def iterate(params, state):
        expected, logs = jax.vmap(partial(hmm.e_step, params))(emissions)
        params, state = hmm.m_step(params, props, expected, state)
        return params, state, logs.sum()

    start = params, hmm.initialize_m_step_state(params, props)
    params, state = start
    logs = []
    for _ in range(1 + more):
        params, state, log = iterate(params, state)
        logs.append(float(log))
    off_dynamax = check("dynamax", logs, np.asarray(params.emissions.means),
                        np.asarray(params.emissions.covs))

    of_hmmlearn, of_dynamax = [], []
    for _ in range(times.repetitions):
        one, all_ = elapsed(lambda: fit(1), 1), elapsed(lambda: fit(1 + more), 1)
        of_hmmlearn.append((all_ - one) / more / steps)
        seconds = elapsed(lambda: jax.block_until_ready(iterate(*start)), more)
        of_dynamax.append(seconds / more / steps)
    times.add(NAME, "iteration", "hmmlearn", off_hmmlearn, of_hmmlearn)
    times.add(NAME, "iteration", "dynamax", off_dynamax, of_dynamax)
