"""dynamax's families, under wayfix's names of cases and parameters."""

from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from dynamax import hidden_markov_model as hmm
from models import Learned
from race import Contender


def same(array):
    """Parameters that are the same arrays."""
    return array


class Parameter(NamedTuple):
    """An argument of `initialize`, a field of the emissions, and conversions to and from dynamax's form."""

    argument: str
    field: str
    there: callable = same
    back: callable = same


class Family(NamedTuple):
    """A class with its arguments except the number of states, its parameters, and its observations from rows.

    Observations are emissions, and inputs where there are any.
    """

    of: type
    options: dict
    parameters: dict
    observed: callable = lambda model, rows: (rows,)


# Dirichlet priors of 1 are flat.
NO_PRIOR = {"initial_probs_concentration": 1.0, "transition_matrix_concentration": 1.0}


def gaussian(of, components, parameter, **options):
    """Families with a mean for each state."""
    parameters = {"means": Parameter("emission_means", "means"), "covariances": parameter}
    return Family(of, {"emission_dim": components} | options, parameters)


def mixture(of, covariances, **options):
    """Two Gaussians for each state."""
    options = {"num_components": 2, "emission_dim": 3, "emission_weights_concentration": 1.0,
               "emission_prior_mean_concentration": 0.0, "emission_prior_scale": 0.0} | options
    return Family(of, options, {"weights": Parameter("emission_weights", "weights"),
                                "means": Parameter("emission_means", "means"),
                                "covariances": covariances})


def wishart(components, more=0.0):
    """The (improper) prior whose posterior mode is the maximum of the likelihood."""
    return {"emission_prior_concentration": 0.0, "emission_prior_scale": 0.0,
            "emission_prior_extra_df": -2.0 * components - more}


def linear(of, there=same, **options):
    """Lines; `there` and `back` change the order of their coefficients."""
    return {"of": of, "options": {"emission_dim": 3} | options, "parameters": {
        "coefficients": Parameter("emission_weights", "weights", there, there),
        "intercepts": Parameter("emission_biases", "biases"),
        "covariances": Parameter("emission_covariances", "covs")}}


def lags_reversed(coefficients):
    """Coefficients with those of the last observation first; wayfix has those of the first one first."""
    states, outputs, inputs = coefficients.shape
    lags = coefficients.reshape(states, outputs, inputs // outputs, outputs)
    return lags[:, :, ::-1].reshape(coefficients.shape)


def lagged(model, rows):
    """Conditions on the first rows, as wayfix does; by default they would be zeros."""
    first, rest = rows[:, :model.num_lags], rows[:, model.num_lags:]
    return rest, jax.vmap(model.compute_inputs)(rest, first)


MATRICES = Parameter("emission_covariances", "covs")
DEVIATIONS = Parameter("emission_scale_diags", "scale_diags", np.sqrt, np.square)
# dynamax takes several symbols, or rows of counts, at a time.
SEVERAL = Parameter("emission_probs", "probs", lambda p: p[:, None, :], lambda p: p[:, 0, :])

FAMILIES = {
    "learning": Family(
        hmm.CategoricalHMM,
        {"emission_dim": 1, "num_classes": 20, "emission_prior_concentration": 1.0},
        {"probabilities": SEVERAL}),
    "gaussian": gaussian(hmm.GaussianHMM, 6, MATRICES, **wishart(6, 2.0)),
    "tied gaussian": gaussian(
        hmm.SharedCovarianceGaussianHMM, 3,
        Parameter("emission_covariance", "cov", lambda c: c[0], lambda c: c[None]),
        **wishart(3, 4 + 1.0)),  # 4 states
    "diagonal gaussian": gaussian(
        hmm.DiagonalGaussianHMM, 3, DEVIATIONS, emission_prior_mean_concentration=0.0,
        emission_prior_concentration=-1.5, emission_prior_scale=0.0),
    "mixture": mixture(hmm.GaussianMixtureHMM, MATRICES, emission_prior_extra_df=-2.0 * 3 - 2.0),
    "diagonal mixture": mixture(
        hmm.DiagonalGaussianMixtureHMM, DEVIATIONS, emission_prior_shape=-1.5),
    "poisson": Family(
        hmm.PoissonHMM,
        {"emission_dim": 3, "emission_prior_concentration": 1.0, "emission_prior_rate": 0.0},
        {"rates": Parameter("emission_rates", "rates")}),
    "bernoulli": Family(
        hmm.BernoulliHMM,
        {"emission_dim": 6, "emission_prior_concentration0": 1.0,
         "emission_prior_concentration1": 1.0},
        {"probabilities": Parameter("emission_probs", "probs")}),
    "multinomial": Family(
        hmm.MultinomialHMM,
        {"emission_dim": 1, "num_classes": 5, "num_trials": 8,
         "emission_prior_concentration": 1.0},
        {"probabilities": SEVERAL}, lambda model, rows: (rows[:, :, None, :],)),
    "regression": Family(
        **linear(hmm.LinearRegressionHMM, input_dim=2),
        observed=lambda model, rows: (rows[:, :, 2:], rows[:, :, :2])),
    "autoregression": Family(
        **linear(hmm.LinearAutoregressiveHMM, lags_reversed, num_lags=2), observed=lagged),
}

# Their M-step follows a gradient for a number of steps, and does not reach the maximum.
GIVEN = {
    "spherical gaussian": gaussian(
        hmm.SphericalGaussianHMM, 3, Parameter("emission_scales", "scales", np.sqrt)),
    "gamma": Family(
        hmm.GammaHMM, {},
        {"shapes": Parameter("emission_concentrations", "concentration", lambda a: a[:, 0]),
         "scales": Parameter("emission_rates", "rate", lambda b: 1.0 / b[:, 0])},
        lambda model, rows: (rows[:, :, 0],)),
}


def started(case, family, prefix=""):
    """The model, its parameters with their properties, and the observations."""
    model = family.of(case.states, **NO_PRIOR, **family.options)
    prior, matrix = case[f"{prefix}prior"], case.rows
    if prefix:
        matrix = case[f"{prefix}transition"].T
    given = {"initial_probs": prior, "transition_matrix": matrix}
    for name, parameter in family.parameters.items():
        given[parameter.argument] = parameter.there(case[prefix + name])
    given = {name: jax.numpy.asarray(array) for name, array in given.items()}
    rows = case["rows"]
    rows = rows.astype(np.int64) if rows.dtype.kind == "u" else rows
    observed = family.observed(model, jax.numpy.asarray(rows))
    if "means" in family.parameters:
        # No parameters are drawn from an improper prior.
        given |= {"method": "kmeans", "emissions": observed[0][0]}
    return model, *model.initialize(jax.random.PRNGKey(0), **given), observed


class Learner:
    """Learns from a case's start, for any number of re-estimations."""

    def __init__(self, case):
        self.family = FAMILIES[case.name]
        self.model, params, props, self.observed = started(case, self.family)

        @jax.jit
        def iterate(params, state):
            each = jax.vmap(partial(self.model.e_step, params))
            expected, logs = each(*self.observed)
            params, state = self.model.m_step(params, props, expected, state)
            return params, state, logs.sum()

        self.iterate = iterate
        self.start = params, self.model.initialize_m_step_state(params, props)

    def fit(self, iterations):
        """Runs a number of re-estimations."""
        at, logs = self.start, []
        for _ in range(iterations):
            *at, log = self.iterate(*at)
            logs.append(log)
        return jax.block_until_ready((at[0], logs))

    def learn(self, iterations):
        """Runs the re-estimations and returns all answers."""
        params, logs = self.fit(iterations)
        found = {name: parameter.back(np.asarray(getattr(params.emissions, parameter.field)))
                 for name, parameter in self.family.parameters.items()}
        found |= {"prior": np.asarray(params.initial.probs),
                  "transition": np.asarray(params.transitions.transition_matrix).T}
        paths = jax.vmap(partial(self.model.most_likely_states, params))(*self.observed)
        return Learned([float(log) for log in logs], found, np.asarray(paths))


def expectation(case, check):
    """Times the E-step from the start, after checking answers under given parameters."""
    family = GIVEN[case.name]
    model, params, _, observed = started(case, family)
    e_step = jax.jit(lambda params: jax.vmap(partial(model.e_step, params))(*observed))
    learned = started(case, family, "learned_")[1]
    logs = [float(e_step(params)[1].sum()) for params in (params, learned)]
    posterior = jax.vmap(partial(model.smoother, learned))(*observed)
    paths = jax.vmap(partial(model.most_likely_states, learned))(*observed)
    off = check((logs, np.asarray(posterior.smoothed_probs), np.asarray(paths)))
    return Contender(lambda: jax.block_until_ready(e_step(params)), case["paths"].size,
                     lambda _: off)
