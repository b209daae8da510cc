"""Times wayfix.hmmlearn against hmmlearn, with the same models, observations and starts.

    OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 python benches/beside_hmmlearn.py [log | scaling] [STATES...]

The first argument is hmmlearn's implementation; the numbers of states are 3, 10 and 30 by default. Where a ratio is
above 1, wayfix is faster. Scores are compared first.
"""

import copy
import logging
import sys
import time
import warnings

import hmmlearn.hmm as theirs
import numpy as np
from wayfix.hmmlearn import hmm as ours

FAMILIES = [("GaussianHMM", {"covariance_type": "diag"}), ("GaussianHMM", {"covariance_type": "full"}),
            ("PoissonHMM", {}), ("CategoricalHMM", {}), ("MultinomialHMM", {}), ("GMMHMM", {"n_mix": 2})]
SHAPES = [(10, 1), (1000, 1), (20, 50)]
VERBS = ["score", "score_samples", "decode", "fit"]


def case(module, name, options, n, rows, implementation):
    """Returns a model with its parameters set, and observations."""
    rng, d = np.random.RandomState(1), 3
    more = {} if module is ours else {"implementation": implementation}
    model = getattr(module, name)(n, init_params="", n_iter=20, tol=-np.inf, **options, **more)
    model.startprob_, model.transmat_ = rng.dirichlet(np.ones(n)), rng.dirichlet(np.ones(n), n)
    X = rng.randn(rows, d) + rng.randint(0, 3, (rows, 1)) * 3
    if name == "GaussianHMM":
        model.means_, model.n_features = rng.randn(n, d) * 2 + 2, d
        full = options["covariance_type"] == "full"
        model.covars_ = np.tile(2 * np.eye(d), (n, 1, 1)) if full else np.full((n, d), 2.0)
    elif name == "GMMHMM":
        model.means_, model.covars_ = rng.randn(n, 2, d) * 2 + 2, np.full((n, 2, d), 2.0)
        model.weights_ = np.full((n, 2), 0.5)
    elif name == "PoissonHMM":
        X, model.lambdas_ = np.abs(2 * X).astype(int), rng.rand(n, d) * 8 + 0.5
    elif name == "CategoricalHMM":
        X, model.emissionprob_ = np.abs(2 * X[:, :1]).astype(int) % 6, rng.dirichlet(np.ones(6), n)
    else:
        X, model.n_trials = rng.multinomial(8, [0.2, 0.3, 0.5], rows), 8
        model.emissionprob_ = rng.dirichlet(np.ones(d), n)
    return model, X


def seconds(work):
    """Returns the least of several times per call, each over as many calls as fill a hundredth of a second."""
    def timed(count):
        begin = time.perf_counter()
        for _ in range(count):
            work()
        return (time.perf_counter() - begin) / count

    count = max(1, int(0.01 / timed(1)))
    return min(timed(count) for _ in range(3))


def main():
    implementation = sys.argv[1] if len(sys.argv) > 1 else "log"
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    ratios = []
    print("model | states | steps | sequences |", " | ".join(VERBS))
    for n in [int(n) for n in sys.argv[2:]] or [3, 10, 30]:
        for steps, count in SHAPES:
            lengths = [steps] * count
            for name, options in FAMILIES:
                (a, X), (b, _) = (case(module, name, options, n, steps * count, implementation)
                                  for module in (theirs, ours))
                np.testing.assert_allclose(b.score(X, lengths), a.score(X, lengths), rtol=1e-10)
                row = []
                for verb in VERBS:
                    times = []
                    for model in (a, b):
                        # From the same start each time; copies take the same time on both sides.
                        fit = lambda m=model: copy.copy(m).fit(X, lengths)  # noqa: E731
                        call = fit if verb == "fit" else lambda m=model: getattr(m, verb)(X, lengths)
                        try:
                            times.append(seconds(call))
                        except ValueError:
                            times.append(np.nan)
                    row.append(times[0] / times[1])
                ratios.append(row)
                kind = " ".join([name, *map(str, options.values())])
                print(f"{kind} | {n} | {steps} | {count} |", " | ".join(f"{r:.1f}" for r in row), flush=True)
    ratios = np.array(ratios)
    print(f"median of {np.isfinite(ratios).sum()}: {np.nanmedian(ratios):.1f}, by verb "
          f"{np.nanmedian(ratios, axis=0).round(1)}, least {np.nanmin(ratios):.2f}, "
          f"below 1: {(ratios < 1).sum()}")


if __name__ == "__main__":
    main()
