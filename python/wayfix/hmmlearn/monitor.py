"""Progress of the re-estimation, and the test for its end."""

import logging
import sys
from collections import deque

import numpy as np

_log = logging.getLogger(__name__)
# A log-likelihood may fall by up to this much from rounding alone.
_ROUNDING = np.finfo(float).eps ** 0.5


class ConvergenceMonitor:
    """Log-likelihoods of the iterations so far.

    For another test of convergence, set ``monitor_`` to an instance of a subclass that overrides ``converged``.

    Parameters
    ----------
    tol : float
        Gain in log-likelihood below which the iterations end.
    n_iter : int
        Largest number of iterations.
    verbose : bool
        If true, each iteration is reported on stderr.

    Attributes
    ----------
    history : deque of float
        Log-likelihood (with a prior, of the data alone) before each re-estimation.
    iter : int
        Number of iterations.
    """

    _template = "{iter:>10d} {log_prob:>16.8f} {delta:>+16.8f}"

    def __init__(self, tol, n_iter, verbose):
        self.tol = tol
        self.n_iter = n_iter
        self.verbose = verbose
        self.history = deque()
        self.iter = 0

    def __repr__(self):
        values = {**vars(self), "history": list(self.history)}
        lines = "".join(f"    {name}={values[name]},\n" for name in sorted(values))
        return f"{type(self).__name__}(\n{lines})"

    def _reset(self):
        self.iter = 0
        self.history.clear()

    def report(self, log_prob):
        """Records an iteration with its log-likelihood."""
        gain = log_prob - self.history[-1] if self.history else np.nan
        if self.verbose:
            line = self._template.format(iter=self.iter + 1, log_prob=log_prob, delta=gain)
            print(line, file=sys.stderr)
        if gain < -_ROUNDING:
            _log.warning("The log-likelihood fell from %s to %s (by %s).",
                         self.history[-1], log_prob, -gain)
        self.history.append(log_prob)
        self.iter += 1

    @property
    def converged(self):
        """True at the last iteration, or if the last gain was below ``tol``."""
        if self.iter == self.n_iter:
            return True
        return len(self.history) > 1 and self.history[-1] - self.history[-2] < self.tol
