"""Baum-Welch with each family of observations by hmmlearn and dynamax."""

import math
from functools import partial

import numpy as np
import with_dynamax
import with_hmmlearn
from models import Case, of_distributions, of_numbers, of_paths, worst
from race import elapsed, within

# Relative tolerance of the logarithms of paths that tie.
TIE = 1e-13

# All cases; those that both libraries have come first.
NAMES = [*with_hmmlearn.FAMILIES,
         *(name for name in with_dynamax.FAMILIES | with_dynamax.GIVEN
           if name not in with_hmmlearn.FAMILIES)]


def run(name, times, out):
    """Compares all re-estimations, the final parameters and their paths, and times one re-estimation."""
    case = Case(out, name)
    learners = {who: module.Learner(case) for who, module in
                (("hmmlearn", with_hmmlearn), ("dynamax", with_dynamax)) if name in module.FAMILIES}
    off = {who: compare(case, who, learner) for who, learner in learners.items()}
    if name in with_dynamax.GIVEN:
        times.race(name, "E-step", {"dynamax": with_dynamax.expectation(case, partial(given, case))})

    more, steps = case.sizes["more"], case["paths"].size
    seconds = {who: [] for who in learners}
    for _ in range(times.repetitions):
        for who, learner in learners.items():
            # The time of one re-estimation is the slope over their number.
            one, all_ = (elapsed(partial(learner.fit, count), 1) for count in (1, 1 + more))
            seconds[who].append((all_ - one) / more / steps)
    for who in learners:
        times.add(name, "iteration", who, off[who], seconds[who])


def compare(case, who, learner):
    """Relative error of the learned parameters."""
    iterations = 1 + case.sizes["more"]
    learned = learner.learn(iterations)
    expected = case.sizes["log_likelihoods"][:iterations]
    off = within(f"{case.name}, {who}", of_numbers(learned.log_likelihoods, expected))
    for name, found in learned.parameters.items():
        right = case[f"learned_{name}"]
        assert found.shape == right.shape, (name, found.shape, right.shape)
        differs = float(np.abs(found - right).max() / np.abs(right).max())
        off = worst(off, within(f"{case.name}, {who}, {name}", differs))
    within(f"{case.name}, {who}, paths", of_paths(*untied(case, learned.paths)))
    return off


def untied(case, paths):
    """Found and expected paths, without those that are equally probable.

    Counts repeat, and paths through the same factors in another order tie: rounding chooses one.
    """
    different = [at for at, (found, expected) in enumerate(zip(paths, case["paths"], strict=True))
                 if not np.array_equal(found, expected)]
    if different and case.name in OF_COUNTS:
        with np.errstate(divide="ignore"):
            prior, matrix = np.log(case["learned_prior"]), np.log(case["learned_transition"])
            logs = OF_COUNTS[case.name](case, case["rows"][different])

        def probability(path, logs):
            steps = logs[np.arange(len(path)), path]
            return math.fsum([prior[path[0]], *matrix[path[1:], path[:-1]], *steps])

        pairs = [[probability(path, logs) for path in (paths[at], case["paths"][at])]
                 for at, logs in zip(different, logs)]
        different = [at for at, (found, expected) in zip(different, pairs)
                     if not math.isclose(found, expected, rel_tol=TIE)]
    return [paths[at] for at in different], [case["paths"][at] for at in different]


def of_events(case, rows):
    """Log-probabilities of each state at each step."""
    p = case["learned_probabilities"]
    return rows @ np.log(p).T + (1 - rows) @ np.log1p(-p).T


# The same, up to a constant for all states.
OF_COUNTS = {
    "learning": lambda case, rows: np.log(case["learned_probabilities"]).T[rows[:, :, 0]],
    "poisson": lambda case, rows: (
        rows @ np.log(case["learned_rates"]).T - case["learned_rates"].sum(axis=1)),
    "bernoulli": of_events,
    "multinomial": lambda case, rows: rows @ np.log(case["learned_probabilities"]).T,
}


def given(case, answers):
    """Relative error of answers under the initial and the learned parameters."""
    log_likelihoods, smoothed, paths = answers
    ends = [case.sizes["log_likelihoods"][at] for at in (0, -1)]
    return worst(of_numbers(log_likelihoods, ends), of_distributions(smoothed, case["smoothed"]),
                 of_paths(paths, case["paths"]))
