"""Baum–Welch for `wayfix.Hmm`: start, moves, and a table or a family of observations.

With a table, call `learn(hmm, sequences)`; for numbers, a model without a table, and a family::

    hmm = wayfix.Hmm(start, moves, logarithms=True)
    family = Family("gamma", shapes=[[1.0], [4.0]], scales=[[1.0], [2.0]])
    learned = learn(hmm, sequences, family)
    learned.hmm.viterbi(learned.family.log_likelihoods(rows)).states
"""

from ._wayfix import Family, Learned, learn

__all__ = ["Family", "Learned", "learn"]
