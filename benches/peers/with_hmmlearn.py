"""hmmlearn's families, under wayfix's names of cases and parameters."""

import logging
import math
from typing import NamedTuple

import numpy as np
from hmmlearn import hmm
from models import Learned

# hmmlearn warns at each start that MultinomialHMM is no longer CategoricalHMM.
logging.getLogger("hmmlearn").setLevel(logging.ERROR)


class Mixture(hmm.GMMHMM):
    """hmmlearn's mixture, with covariances about the new means instead of the old ones."""

    def _do_mstep(self, stats):
        before = self.means_.copy()
        super()._do_mstep(stats)
        moved = self.means_ - before
        if self.covariance_type == "full":
            self.covars_ -= moved[..., :, None] * moved[..., None, :]
        else:
            self.covars_ -= moved ** 2


class Family(NamedTuple):
    """A class, its options, and its attributes of parameters."""

    of: type
    options: dict
    attributes: dict


def gaussian(kind):
    """Without a prior."""
    return Family(hmm.GaussianHMM, {"covariance_type": kind, "covars_prior": 0},
                  {"means": "means_", "covariances": "covars_"})


def mixture(kind):
    """Without a prior by default."""
    return Family(Mixture, {"covariance_type": kind, "n_mix": 2},
                  {"weights": "weights_", "means": "means_", "covariances": "covars_"})


FAMILIES = {
    "learning": Family(hmm.CategoricalHMM, {"n_features": 20}, {"probabilities": "emissionprob_"}),
    "gaussian": gaussian("full"),
    "tied gaussian": gaussian("tied"),
    "diagonal gaussian": gaussian("diag"),
    "spherical gaussian": gaussian("spherical"),
    "mixture": mixture("full"),
    "diagonal mixture": mixture("diag"),
    "poisson": Family(hmm.PoissonHMM, {}, {"rates": "lambdas_"}),
    "multinomial": Family(hmm.MultinomialHMM, {"n_trials": 8}, {"probabilities": "emissionprob_"}),
}

# Covariances of a GaussianHMM, which returns matrices, in wayfix's form.
OF_MATRICES = {
    "full": lambda matrices: matrices,
    "tied": lambda matrices: matrices[:1],
    "diag": lambda matrices: np.einsum("kii->ki", matrices),
    # After learning, there is one for each state and component.
    "spherical": lambda matrices: matrices[::matrices.shape[1], 0, 0],
}


class Learner:
    """Learns from a case's start, for any number of re-estimations."""

    def __init__(self, case):
        self.case, self.family = case, FAMILIES[case.name]
        rows = case["rows"]
        whole = self.family.of in (hmm.CategoricalHMM, hmm.PoissonHMM, hmm.MultinomialHMM)
        self.together = rows.reshape(-1, rows.shape[2]).astype(np.int64 if whole else float)
        self.lengths = [rows.shape[1]] * len(rows)

    def fit(self, iterations):
        """Runs a number of re-estimations through the public class."""
        of, options, attributes = self.family
        model = of(self.case.states, n_iter=iterations, tol=-math.inf, init_params="",
                   implementation="scaling", **options)
        model.startprob_, model.transmat_ = self.case["prior"].copy(), self.case.rows
        for name, attribute in attributes.items():
            value = self.case[name].copy()
            tied = name == "covariances" and options["covariance_type"] == "tied"
            setattr(model, attribute, value[0] if tied else value)
        return model.fit(self.together, self.lengths)

    def learn(self, iterations):
        """Runs the re-estimations and returns all answers."""
        of, options, attributes = self.family
        model = self.fit(iterations)
        found = {name: getattr(model, attribute) for name, attribute in attributes.items()}
        if of is hmm.GaussianHMM:
            found["covariances"] = OF_MATRICES[options["covariance_type"]](found["covariances"])
        found |= {"prior": model.startprob_, "transition": model.transmat_.T}
        paths = model.predict(self.together, self.lengths).reshape(len(self.lengths), -1)
        return Learned(list(model.monitor_.history), found, paths)
