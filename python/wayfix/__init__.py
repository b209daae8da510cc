"""Exact hidden Markov inference on numpy arrays: filter, smoother, Viterbi, and learning by the
classes of :mod:`wayfix.hmmlearn` or :mod:`wayfix.learning`; places by images in :mod:`wayfix.recognition`, GPS on
roads in :mod:`wayfix.matching`, and columns of other packages in :mod:`wayfix.arrow`."""

from ._wayfix import Error, Filter, FixedLag, Hmm, ImpossibleError, Path, Smoothed, __version__

__all__ = ["Error", "Filter", "FixedLag", "Hmm", "ImpossibleError", "Path", "Smoothed", "__version__"]
