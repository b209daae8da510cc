"""Baum-Welch by hmmlearn and dynamax."""

import math
from functools import partial

import jax
import numpy as np
from dynamax.hidden_markov_model import CategoricalHMM as DynamaxCategorical
from hmmlearn.hmm import CategoricalHMM as HmmlearnCategorical
from models import Case, of_distributions, of_numbers, worst
from race import elapsed, within

NAME = "learning"


def run(times, out):
    """Compares all re-estimations, and times one."""
    case = Case(out, NAME)
    sizes = case.sizes
    states, more = sizes["states"], sizes["more"]
    symbols = case["symbols"].astype(np.int64)
    steps = symbols.size

    def check(who, logs, rows):
        off = worst(of_numbers(logs, sizes["log_likelihoods"][:len(logs)]),
                    of_distributions(rows, case["learned_transition"].T))
        return within(f"{NAME}, {who}", off)

    together, lengths = symbols.reshape(-1, 1), [symbols.shape[1]] * len(symbols)

    def fit(iterations):
        hmm = HmmlearnCategorical(
            states, n_iter=iterations, tol=-math.inf, init_params="", implementation="scaling")
        hmm.startprob_, hmm.transmat_ = case["prior"].copy(), case.rows
        hmm.emissionprob_ = case["table"].copy()
        return hmm.fit(together, lengths)

    hmm = fit(1 + more)
    off_hmmlearn = check("hmmlearn", list(hmm.monitor_.history), hmm.transmat_)

    # Dirichlet priors of 1 are none.
    hmm = DynamaxCategorical(
        states, 1, sizes["symbols"], initial_probs_concentration=1.0,
        transition_matrix_concentration=1.0, emission_prior_concentration=1.0)
    params, props = hmm.initialize(
        jax.random.PRNGKey(0), initial_probs=jax.numpy.asarray(case["prior"]),
        transition_matrix=jax.numpy.asarray(case.rows),
        emission_probs=jax.numpy.asarray(case["table"][:, None, :]))
    emissions = jax.numpy.asarray(symbols[:, :, None])

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
    off_dynamax = check("dynamax", logs, np.asarray(params.transitions.transition_matrix))

    of_hmmlearn, of_dynamax = [], []
    for _ in range(times.repetitions):
        one, all_ = elapsed(lambda: fit(1), 1), elapsed(lambda: fit(1 + more), 1)
        of_hmmlearn.append((all_ - one) / more / steps)
        seconds = elapsed(lambda: jax.block_until_ready(iterate(*start)), more)
        of_dynamax.append(seconds / more / steps)
    times.add(NAME, "iteration", "hmmlearn", off_hmmlearn, of_hmmlearn)
    times.add(NAME, "iteration", "dynamax", off_dynamax, of_dynamax)
