"""Exact hidden Markov inference on numpy arrays: filter, smoother, Viterbi, and learning by the
classes of :mod:`wayfix.hmmlearn`."""

from ._wayfix import Error, Filter, FixedLag, Hmm, ImpossibleError, Path, Smoothed, __version__

__all__ = ["Error", "Filter", "FixedLag", "Hmm", "ImpossibleError", "Path", "Smoothed", "__version__"]
