"""Times routines in turn, after comparing their answers."""

import math
import statistics
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

# Relative tolerance of answers.
TOLERANCE = 1e-9
# Least duration of a repetition in seconds; shorter routines are called repeatedly.
REPETITION = 0.02


class Contender(NamedTuple):
    """A library's routine, the number of steps of a call, and the error of its answer."""

    work: Callable
    steps: int
    check: Callable


class Times:
    """Times of each library, in microseconds per step."""

    def __init__(self, repetitions):
        self.repetitions = repetitions
        self.rows = []

    def race(self, case, routine, contenders):
        """Compares the answers of {who: contender}, then times each in turn."""
        off, calls, times = {}, {}, {}
        for who, (work, _, check) in contenders.items():
            off[who] = within(f"{case}, {routine}, {who}", check(work()))
            calls[who] = math.ceil(REPETITION / max(elapsed(work, 1), 1e-9))
            times[who] = []
        for _ in range(self.repetitions):
            for who, (work, steps, _) in contenders.items():
                times[who].append(elapsed(work, calls[who]) / calls[who] / steps)
        for who in contenders:
            self.add(case, routine, who, off[who], times[who])

    def add(self, case, routine, who, off, times):
        """Adds times, in seconds per step."""
        times = [1e6 * seconds for seconds in times]
        median = statistics.median(times)
        self.rows.append((case, routine, who, median, min(times), max(times), off))
        print(f"{case}, {routine}, {who}: {median:.4f} µs", file=sys.stderr)


def within(what, difference):
    """Returns the difference, and raises if it exceeds the tolerance."""
    if not difference <= TOLERANCE:
        sys.exit(f"{what}: differs by {difference:.1e}, more than {TOLERANCE:.0e}")
    return difference


def elapsed(work, calls):
    """Seconds for a number of calls."""
    start = time.perf_counter()
    for _ in range(calls):
        work()
    return time.perf_counter() - start
