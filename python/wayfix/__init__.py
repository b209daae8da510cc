"""Exact inference in hidden Markov models on numpy arrays: filter, smoother and Viterbi.

Models are learned with the classes of :mod:`wayfix.hmmlearn` or with :mod:`wayfix.learning`. Places are recognised by
images in :mod:`wayfix.recognition`, GPS points are matched to roads in :mod:`wayfix.matching`, and columns of other
packages are read by :mod:`wayfix.arrow`.
"""

from ._wayfix import Error, Filter, FixedLag, Hmm, ImpossibleError, Path, Smoothed, __version__

__all__ = ["Error", "Filter", "FixedLag", "Hmm", "ImpossibleError", "Path", "Smoothed", "__version__"]
