"""Regressions that switch, by statsmodels.

Its re-estimations are not compared: moves are divided by the time in the state they lead from,
the last step included, and those that depend on inputs are left as they are.
"""

from functools import partial

import numpy as np
from models import Case
from race import Contender
from statsmodels.tsa.regime_switching.markov_regression import MarkovRegression

REGRESSION, WITH_INPUTS = "switching regression", "moves with inputs"


def run(name, times, out):
    """Compares and times the log-likelihood and the smoother."""
    case = Case(out, name)
    model, parameters = of_statsmodels(case)
    routines = {
        "score": partial(model.loglike, parameters),
        "smooth": partial(smooth, model, parameters),
    }
    for routine, work in routines.items():
        contender = Contender(work, case.sizes["steps"], case.check(routine))
        times.race(name, routine, {"statsmodels": contender})


def of_statsmodels(case):
    """A model and its vector of parameters."""
    rows, n = case["rows"], case.states
    with_inputs = case.name == WITH_INPUTS
    inputs = with_constant(case["inputs"]) if with_inputs else None
    model = MarkovRegression(rows[:, -1], n, exog=rows[:, :-1], exog_tvtp=inputs,
                             switching_variance=True)
    model.initialize_known(case["prior"])
    parameters = np.zeros(model.k_params)
    for state in range(n):
        at = partial(lambda state, kind: model.parameters[state, kind], state)
        if with_inputs:
            # Log-odds against the move to the last state, one after the other.
            odds = np.column_stack([case["move_intercepts"][state], case["move_slopes"][state]])
            parameters[at("regime_transition")] = (odds[:-1] - odds[-1]).ravel()
        else:
            parameters[at("regime_transition")] = case.rows[state, :-1]
        parameters[at("exog")] = [case["intercepts"][state], *case["coefficients"][state]]
        parameters[at("variance")] = case["variances"][state]
    return model, parameters


def with_constant(inputs):
    """Rows with a leading 1."""
    return np.column_stack([np.ones(len(inputs)), inputs])


def smooth(model, parameters):
    """Log-likelihood and posteriors."""
    result = model.smooth(parameters, return_raw=True)
    return result.llf, result.smoothed_marginal_probabilities.T
