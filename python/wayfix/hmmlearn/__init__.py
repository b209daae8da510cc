"""hmmlearn's classes on top of wayfix: ``from wayfix.hmmlearn import hmm``.

Constructors, attributes and methods are those of hmmlearn 0.3.3. The README of the package lists
where answers differ, and why.
"""

from .. import __version__
from . import base, hmm
from .hmm import CategoricalHMM, GaussianHMM, GMMHMM, MultinomialHMM, PoissonHMM

__all__ = [
    "CategoricalHMM", "GMMHMM", "GaussianHMM", "MultinomialHMM", "PoissonHMM", "__version__", "base",
    "hmm",
]
