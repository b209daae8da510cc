"""Families of observations, with the constructors and attributes of ``hmmlearn.hmm``."""

from .base import BaseHMM
from .counts import CategoricalHMM, MultinomialHMM, PoissonHMM
from .gaussian import GaussianHMM
from .gmm import GMMHMM

__all__ = ["BaseHMM", "CategoricalHMM", "GMMHMM", "GaussianHMM", "MultinomialHMM", "PoissonHMM"]
