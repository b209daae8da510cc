#!/usr/bin/env python3
"""Times hmmlearn, dynamax, scipy and numpy beside wayfix: one table of ratios.

Builds and runs the Rust program beside this file before and after, on the same
core; reads its models, observations and answers; and times nothing whose answer
differs.
"""

import argparse
import csv
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=HERE / "target" / "peers",
                        help="folder for models, answers and tables")
    parser.add_argument("--graph", type=Path,
                        help="folder with a road graph, nodes.csv and edges.csv")
    parser.add_argument("--repetitions", type=int, default=9,
                        help="how often each routine is timed, 7 or more")
    parser.add_argument("--core", type=int, default=max(os.sched_getaffinity(0)),
                        help="the core that all run on")
    arguments = parser.parse_args()
    if arguments.repetitions < 7:
        parser.error("--repetitions: 7 or more")
    return arguments


# One core, one thread and doubles: before any of the libraries starts.
ARGUMENTS = parse_arguments()
os.sched_setaffinity(0, {ARGUMENTS.core})
for threads in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
    os.environ[f"{threads}_NUM_THREADS"] = "1"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_PLATFORMS"] = "cpu"
os.environ["JAX_ENABLE_X64"] = "1"

import jax  # noqa: E402
import numpy as np  # noqa: E402
import scipy.sparse  # noqa: E402
from dynamax.hidden_markov_model import CategoricalHMM as DynamaxCategorical  # noqa: E402
from dynamax.hidden_markov_model.inference import (  # noqa: E402
    hmm_filter, hmm_posterior_mode, hmm_smoother)
from hmmlearn import _hmmc  # noqa: E402
from hmmlearn.hmm import CategoricalHMM as HmmlearnCategorical  # noqa: E402

TOLERANCE = 1e-9
# What a repetition takes at least, in seconds; a shorter routine is called often.
REPETITION = 0.02


class Case:
    """A model, observations and answers, as the Rust program wrote them."""

    def __init__(self, name):
        folder = ARGUMENTS.out / name
        self.name = name
        self.sizes = json.loads((folder / "model.json").read_text())
        self.arrays = {path.stem: np.load(path) for path in folder.glob("*.npy")}
        self.states = self.sizes["states"]
        to, from_ = self["to"].astype(np.int32), self["from"].astype(np.int32)
        shape = (self.states, self.states)
        # Columns sum to one.
        self.sparse = scipy.sparse.csr_array((self["probability"], (to, from_)), shape)

    def __getitem__(self, name):
        return self.arrays[name]

    @property
    def rows(self):
        """The transition matrix as hmmlearn and dynamax take it: rows sum to one."""
        return np.ascontiguousarray(self.sparse.toarray().T)

    def logs(self):
        with np.errstate(divide="ignore"):
            return np.log(self["likelihoods"])


def of_numbers(found, expected):
    """How far numbers are off, relatively to those expected."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    return float(np.max(np.abs(found - expected) / np.abs(expected)))


def of_distributions(found, expected):
    """How far distributions are off, relatively to the largest probability of each."""
    found = np.asarray(found)
    assert found.shape == expected.shape, (found.shape, expected.shape)
    return float(np.max(np.abs(found - expected).max(-1) / expected.max(-1)))


def of_paths(found, expected):
    """0 for the same path, else infinite."""
    return 0.0 if np.array_equal(found, expected) else math.inf


def answers(case, kind):
    """What the answer of such a routine is compared with."""
    log = partial(of_numbers, expected=case.sizes.get("log_likelihood"))
    return {
        "filter": lambda a: max(log(a[0]), of_distributions(a[1], case["filtered"][-1])),
        "forward": lambda a: max(log(a[0]), of_distributions(a[1], case["filtered"])),
        "smooth": lambda a: max(log(a[0]), of_distributions(a[1], case["smoothed"])),
        "score": log,
        "viterbi": lambda path: of_paths(path, case["path"]),
    }[kind]


class Times:
    """What each library took, in microseconds a step."""

    def __init__(self):
        self.rows = []

    def race(self, case, routine, steps, contenders, check):
        """Compares the answers of {who: routine}, then times each in turn."""
        off, calls, times = {}, {}, {}
        for who, work in contenders.items():
            off[who] = check(work())
            if not off[who] <= TOLERANCE:
                sys.exit(f"{case}, {routine}, {who}: differs by {off[who]:.1e}")
            calls[who] = math.ceil(REPETITION / max(elapsed(work, 1), 1e-9))
            times[who] = []
        for _ in range(ARGUMENTS.repetitions):
            for who, work in contenders.items():
                times[who].append(elapsed(work, calls[who]) / calls[who] / steps)
        for who in contenders:
            self.add(case, routine, who, off[who], times[who])

    def add(self, case, routine, who, off, times):
        times = [1e6 * seconds for seconds in times]
        row = [statistics.median(times), min(times), max(times), off]
        self.rows.append((case, routine, who, *row))
        print(f"{case}, {routine}, {who}: {row[0]:.4f} µs", file=sys.stderr)


def elapsed(work, calls):
    start = time.perf_counter()
    for _ in range(calls):
        work()
    return time.perf_counter() - start


def of_hmmlearn(case):
    """The compiled routines that hmmlearn's own methods call."""
    prior, rows, likelihoods, logs = case["prior"], case.rows, case["likelihoods"], case.logs()

    def forward():
        return _hmmc.forward_scaling(prior, rows, likelihoods)[:2]

    return {
        "forward": forward,
        "score": lambda: forward()[0],
        "smooth": lambda: smooth_by_hmmlearn(prior, rows, likelihoods),
        "viterbi": lambda: _hmmc.viterbi(prior, rows, logs)[1],
    }


def smooth_by_hmmlearn(prior, rows, likelihoods):
    log, forward, scaling = _hmmc.forward_scaling(prior, rows, likelihoods)
    posteriors = forward * _hmmc.backward_scaling(prior, rows, likelihoods, scaling)
    posteriors /= posteriors.sum(axis=1, keepdims=True)
    return log, posteriors


def of_dynamax(case):
    """Compiled once; what is not returned is not computed."""
    given = [jax.device_put(array) for array in (case["prior"], case.rows, case.logs())]

    def compiled(routine):
        routine = jax.jit(routine)
        return lambda: jax.block_until_ready(routine(*given))

    def forward(*given):
        posterior = hmm_filter(*given)
        return posterior.marginal_loglik, posterior.filtered_probs

    return {
        "forward": compiled(forward),
        "score": compiled(lambda *given: hmm_filter(*given).marginal_loglik),
        "smooth": compiled(smooth_by_dynamax),
        "viterbi": compiled(hmm_posterior_mode),
    }


def smooth_by_dynamax(prior, rows, logs):
    posterior = hmm_smoother(prior, rows, logs)
    return posterior.marginal_loglik, posterior.smoothed_probs


def of_scipy(case):
    """Loops over products of a CSR matrix and a vector."""
    prior, likelihoods, steps = case["prior"], case["likelihoods"], len(case["likelihoods"])
    matrix, transposed = case.sparse, case.sparse.T.tocsr()
    factors = np.empty(steps)

    def advance(step, x):
        x = matrix @ x if step else prior.copy()
        x *= likelihoods[step]
        factors[step] = factor = x.sum()
        x /= factor
        return x

    def stream():
        x = None
        for step in range(steps):
            x = advance(step, x)
        return np.log(factors).sum(), x

    def forward():
        filtered = np.empty_like(likelihoods)
        x = None
        for step in range(steps):
            filtered[step] = x = advance(step, x)
        return np.log(factors).sum(), filtered

    def smooth():
        log, smoothed = forward()
        beta = np.ones(case.states)
        for step in range(steps - 1, 0, -1):
            beta *= likelihoods[step]
            beta /= factors[step]
            beta = transposed @ beta
            smoothed[step - 1] *= beta
        return log, smoothed

    return {"filter": stream, "forward": forward, "smooth": smooth}


def given(times, name, kinds, libraries):
    """A model with given likelihoods, and the routines that are compared."""
    case = Case(name)
    offered = {who: library(case) for who, library in libraries.items()}
    for kind in kinds:
        contenders = {who: routines[kind] for who, routines in offered.items() if kind in routines}
        steps = case.sizes["steps"]
        times.race(name, kind, steps, contenders, answers(case, kind))


def many(times):
    """Many sequences, smoothed."""
    name = "road map 2000 x 50"
    case = Case(name)
    steps, sequences = case.sizes["steps"], case.sizes["sequences"]
    prior, rows, likelihoods = case["prior"], case.rows, case["likelihoods"]

    def check(count, answer):
        logs, smoothed = answer
        smoothed = np.asarray(smoothed)
        return max(
            of_numbers(logs, case["log_likelihoods"][:count]),
            of_distributions(smoothed[:, 0], case["smoothed_first"][:count]),
            of_distributions(smoothed.sum(axis=1), case["smoothed_sum"][:count]))

    def race(who, work, count):
        times.race(name, "smooth", count * steps, {who: work}, partial(check, count))

    blocks = [np.ascontiguousarray(likelihoods[start:start + BLOCK].transpose(1, 2, 0))
              for start in range(0, sequences, BLOCK)]
    matrix = case.sparse.toarray()
    transposed = np.ascontiguousarray(matrix.T)

    def by_numpy():
        return [smooth_block(prior, matrix, transposed, block) for block in blocks]

    def check_numpy(answer):
        logs = np.concatenate([log for log, _ in answer])
        smoothed = np.concatenate([block.transpose(2, 0, 1) for _, block in answer])
        return check(sequences, (logs, smoothed))

    times.race(name, "smooth", sequences * steps, {"numpy (GEMM)": by_numpy}, check_numpy)

    all_at_once = jax.jit(jax.vmap(smooth_by_dynamax, (None, None, 0)))
    arrays = [jax.device_put(array) for array in (prior, rows, np.log(likelihoods))]
    race("dynamax (vmap)", lambda: jax.block_until_ready(all_at_once(*arrays)), sequences)

    def one_by_one():
        answers = [smooth_by_hmmlearn(prior, rows, one) for one in likelihoods[:FEW]]
        return [log for log, _ in answers], np.stack([smoothed for _, smoothed in answers])

    race("hmmlearn", one_by_one, FEW)


# The sequences that go through numpy's products together: what the caches hold.
BLOCK = 250
# The sequences that hmmlearn takes one by one: enough for a time a step.
FEW = 100


def smooth_block(prior, matrix, transposed, likelihoods):
    """Smooths sequences of one length; the arrays are steps x states x sequences."""
    smoothed = np.empty_like(likelihoods)
    scales = np.empty((likelihoods.shape[0], 1, likelihoods.shape[2]))
    for step, likelihood in enumerate(likelihoods):
        x = smoothed[step]
        if step:
            np.matmul(matrix, smoothed[step - 1], out=x)
            x *= likelihood
        else:
            np.multiply(prior[:, None], likelihood, out=x)
        np.sum(x, axis=0, keepdims=True, out=scales[step])
        np.reciprocal(scales[step], out=scales[step])
        x *= scales[step]
    beta = np.ones_like(likelihoods[0])
    for step in range(len(likelihoods) - 1, 0, -1):
        beta *= likelihoods[step]
        beta *= scales[step]
        beta = np.matmul(transposed, beta)
        smoothed[step - 1] *= beta
    return -np.log(scales).sum(axis=(0, 1)), smoothed


def learning(times):
    """Baum-Welch: the time of a re-estimation."""
    name = "learning"
    case = Case(name)
    sizes = case.sizes
    states, more = sizes["states"], sizes["more"]
    symbols = case["symbols"].astype(np.int64)
    steps = symbols.size

    def check(logs, rows):
        off = max(of_numbers(logs, sizes["log_likelihoods"][:len(logs)]),
                  of_distributions(rows, case["learned_transition"].T))
        if not off <= TOLERANCE:
            sys.exit(f"{name}: differs by {off:.1e}")
        return off

    together, lengths = symbols.reshape(-1, 1), [symbols.shape[1]] * len(symbols)

    def fit(iterations):
        hmm = HmmlearnCategorical(
            states, n_iter=iterations, tol=-math.inf, init_params="", implementation="scaling")
        hmm.startprob_, hmm.transmat_ = case["prior"].copy(), case.rows
        hmm.emissionprob_ = case["table"].copy()
        return hmm.fit(together, lengths)

    hmm = fit(1 + more)
    off_hmmlearn = check(list(hmm.monitor_.history), hmm.transmat_)

    # Dirichlet priors of 1 are none.
    hmm = DynamaxCategorical(
        states, 1, sizes["symbols"], initial_probs_concentration=1.0,
        transition_matrix_concentration=1.0, emission_prior_concentration=1.0)
    params, props = hmm.initialize(
        jax.random.PRNGKey(0), initial_probs=jax.numpy.asarray(case["prior"]),
        transition_matrix=jax.numpy.asarray(case.rows),
        emission_probs=jax.numpy.asarray(case["table"][:, None, :]))
    emissions = jax.numpy.asarray(symbols[:, :, None])

    @jax.jit
    def iterate(params, state):
        statistics_, logs = jax.vmap(partial(hmm.e_step, params))(emissions)
        params, state = hmm.m_step(params, props, statistics_, state)
        return params, state, logs.sum()

    start = params, hmm.initialize_m_step_state(params, props)
    params, state = start
    logs = []
    for _ in range(1 + more):
        params, state, log = iterate(params, state)
        logs.append(float(log))
    off_dynamax = check(logs, np.asarray(params.transitions.transition_matrix))

    of_hmmlearn, of_dynamax = [], []
    for _ in range(ARGUMENTS.repetitions):
        one, all_ = elapsed(lambda: fit(1), 1), elapsed(lambda: fit(1 + more), 1)
        of_hmmlearn.append((all_ - one) / more / steps)
        seconds = elapsed(lambda: jax.block_until_ready(iterate(*start)), more)
        of_dynamax.append(seconds / more / steps)
    times.add(name, "iteration", "hmmlearn", off_hmmlearn, of_hmmlearn)
    times.add(name, "iteration", "dynamax", off_dynamax, of_dynamax)


def run_rust(which):
    """What wayfix and the crates take: {(case, routine, who): numbers}."""
    command = [HERE / "target" / "release" / "peers", "--out", ARGUMENTS.out,
               "--repetitions", str(ARGUMENTS.repetitions)]
    if ARGUMENTS.graph:
        command += ["--graph", ARGUMENTS.graph]
    subprocess.run(command, check=True)
    path = ARGUMENTS.out / "times.csv"
    with path.open() as file:
        rows = {(row["case"], row["routine"], row["who"]):
                [float(row[name]) for name in ("median_us", "min_us", "max_us", "difference")]
                for row in csv.DictReader(file)}
    path.rename(ARGUMENTS.out / f"times {which}.csv")
    return rows


def both_runs(before, after):
    """The mean of the medians, the least and the most."""
    return {key: [(before[key][0] + after[key][0]) / 2, min(before[key][1], after[key][1]),
                  max(before[key][2], after[key][2]), before[key][3]] for key in before}


COLUMNS = ["case", "routine", "wayfix_us", "wayfix_min_us", "wayfix_max_us", "peer", "peer_us",
           "peer_min_us", "peer_max_us", "ratio", "difference"]


def ratios(rust, python):
    """A row for each peer, in the order of the cases."""
    everyone = [(*key, *numbers) for key, numbers in rust.items()] + python
    order = {(case, routine): at for at, (case, routine, who) in reversed(
        list(enumerate(rust))) if who == "wayfix"}
    peers = [row for row in everyone if row[2] != "wayfix"]
    for case, routine, who, *numbers in sorted(peers, key=lambda row: order[row[:2]]):
        wayfix = rust[case, routine, "wayfix"]
        yield [case, routine, *wayfix[:3], who, *numbers[:3], numbers[0] / wayfix[0], numbers[3]]


def markdown(rows):
    def with_spread(numbers):
        median, least, most = (f"{number:.3g}" if number < 100 else f"{number:.0f}"
                               for number in numbers)
        return f"{median} ({least}–{most})"

    yield "| case | routine | wayfix µs | peer | peer µs | ratio | difference |"
    yield "|---|---|---|---|---|---|---|"
    for row in rows:
        case, routine, who, ratio, off = row[0], row[1], row[5], row[9], row[10]
        yield (f"| {case} | {routine} | {with_spread(row[2:5])} | {who} | "
               f"{with_spread(row[6:9])} | {ratio:.2f} | {off:.0e} |")


def setting():
    """Machine and versions, in a line."""
    cpu = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        names = [line.split(":")[1].strip() for line in information.read_text().splitlines()
                 if line.startswith("model name")]
        cpu = names[0] if names else cpu
    rustc = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True)
    lock = (HERE / "Cargo.lock").read_text().split("[[package]]")
    crates = [part.split('"') for part in lock[1:]]
    parts = [f"{part[1]} {part[3]}" for part in crates if part[1] in ("bio", "hmmm", "faer")]
    python = ("hmmlearn", "dynamax", "jax", "numpy", "scipy")
    parts += [f"{name} {version(name)}" for name in python]
    return (f"One core of {cpu}; {' '.join(rustc.stdout.split()[:2])}, CPython "
            f"{platform.python_version()}; {', '.join(parts)}; {ARGUMENTS.repetitions} repetitions: "
            "median (least–most), µs a step; wayfix and the crates twice as many, before and after.")


def main():
    subprocess.run(["cargo", "build", "--release", "--locked", "--quiet"], cwd=HERE, check=True)
    ARGUMENTS.out = ARGUMENTS.out.resolve()
    ARGUMENTS.out.mkdir(parents=True, exist_ok=True)
    before = run_rust("before")
    times = Times()
    of_both = {"hmmlearn": of_hmmlearn, "dynamax": of_dynamax}
    kinds = ["forward", "score", "smooth", "viterbi"]
    given(times, "road map", ["filter", *kinds], {**of_both, "scipy (CSR)": of_scipy})
    if ARGUMENTS.graph:
        given(times, "graph", ["filter", "forward", "smooth"], {"scipy (CSR)": of_scipy})
    many(times)
    given(times, "two states", kinds, of_both)
    given(times, "dense 1000", kinds, of_both)
    learning(times)
    rust = both_runs(before, run_rust("after"))

    rows = list(ratios(rust, times.rows))
    with (ARGUMENTS.out / "ratios.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    table = "\n".join(markdown(rows)) + "\n\n" + setting() + "\n"
    (ARGUMENTS.out / "ratios.md").write_text(table)
    print(table)


if __name__ == "__main__":
    main()
