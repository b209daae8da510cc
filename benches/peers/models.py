"""Models, observations and answers that the Rust program wrote."""

import json
import math
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.sparse


class Case:
    """One case, with its arrays as items."""

    def __init__(self, out, name):
        folder = out / name
        self.name = name
        self.sizes = json.loads((folder / "model.json").read_text())
        self.arrays = {path.stem: np.load(path) for path in folder.glob("*.npy")}
        self.states = self.sizes["states"]
        to, from_ = self["to"].astype(np.int32), self["from"].astype(np.int32)
        shape = (self.states, self.states)
        # Columns sum to one.
        self.sparse = scipy.sparse.csr_array((self["probability"], (to, from_)), shape)

    def __getitem__(self, name):
        return self.arrays[name]

    @property
    def rows(self):
        """The transition matrix for hmmlearn and dynamax, whose rows sum to one."""
        return np.ascontiguousarray(self.sparse.toarray().T)

    def logs(self):
        """The likelihoods in dynamax's form."""
        with np.errstate(divide="ignore"):
            return np.log(self["likelihoods"])

    def check(self, routine):
        """Error of an answer of this routine."""
        log = partial(of_numbers, expected=self.sizes["log_likelihood"])

        def both(distributions):
            return lambda answer: worst(log(answer[0]), of_distributions(answer[1], distributions))

        return {
            "filter": both(self["filtered"][-1]),
            "forward": both(self["filtered"]),
            "score": log,
            "smooth": both(self["smoothed"]),
            "viterbi": lambda path: of_paths(path, self["path"]),
        }[routine]


class Learned(NamedTuple):
    """Log-likelihoods before each re-estimation and after the last, and the final parameters."""

    log_likelihoods: list
    parameters: dict
    paths: np.ndarray


def of_numbers(found, expected):
    """Largest error of numbers, relative to the expected ones."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    assert found.shape == expected.shape, (found.shape, expected.shape)
    return float(np.max(np.abs(found - expected) / np.abs(expected)))


def of_distributions(found, expected):
    """Largest error of distributions, relative to the largest probability of each."""
    found = np.asarray(found)
    assert found.shape == expected.shape, (found.shape, expected.shape)
    return float(np.max(np.abs(found - expected).max(-1) / expected.max(-1)))


def of_paths(found, expected):
    """0 for the same path, and infinity for another."""
    return 0.0 if np.array_equal(found, expected) else math.inf


def worst(*differences):
    """The largest number; NaN if one is NaN, which `max` may overlook."""
    return float(np.max(differences))
