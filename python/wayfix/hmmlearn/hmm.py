"""Families of observations, with the constructors and attributes of ``hmmlearn.hmm``."""

from .counts import CategoricalHMM, MultinomialHMM, PoissonHMM
from .gaussian import GaussianHMM
from .gmm import GMMHMM

__all__ = ["CategoricalHMM", "GMMHMM", "GaussianHMM", "MultinomialHMM", "PoissonHMM"]
