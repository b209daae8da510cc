"""Routines take turns at being timed, after their answers were compared."""

import math
import statistics
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

# What an answer may differ by, relatively.
TOLERANCE = 1e-9
# What a repetition takes at least, in seconds; a shorter routine is called often.
REPETITION = 0.02


class Contender(NamedTuple):
    """A library's routine, the steps that a call goes through, and how far its answer is off."""

    work: Callable
    steps: int
    check: Callable


class Times:
    """What each library took, in microseconds a step."""

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
        """Adds times, in seconds a step."""
        times = [1e6 * seconds for seconds in times]
        median = statistics.median(times)
        self.rows.append((case, routine, who, median, min(times), max(times), off))
        print(f"{case}, {routine}, {who}: {median:.4f} µs", file=sys.stderr)


def within(what, difference):
    """The difference, unless it is larger than the tolerance."""
    if not difference <= TOLERANCE:
        sys.exit(f"{what}: differs by {difference:.1e}, more than {TOLERANCE:.0e}")
    return difference


def elapsed(work, calls):
    """The seconds that so many calls take."""
    start = time.perf_counter()
    for _ in range(calls):
        work()
    return time.perf_counter() - start
