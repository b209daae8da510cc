"""A program that types are checked in."""

import numpy as np
import wayfix

hmm = wayfix.Hmm([0.5, 0.5], np.eye(2), table=[[0.5, 0.5], [0.1, 0.9]])
live: wayfix.Filter = hmm.filter()
surprise: float = live.step(1)
best: int = live.mode
paths: list[wayfix.Path] = hmm.k_best([0, 1], 3)
rows = hmm.smooth([0, 1]).probabilities
print(surprise, best, paths[0].states.sum(), rows.mean(), hmm.score_all([[0], [1, 1]]).sum())
