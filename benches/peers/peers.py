#!/usr/bin/env python3
"""Times wayfix against hmmlearn, dynamax, statsmodels, scipy and numpy, in one table of ratios.

Builds the Rust program beside this file and runs it before and after each case,
on the same core; reads its models, observations and answers; and times nothing
whose answer differs.
"""

import argparse
import csv
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent


def parse_arguments():
    """The command line."""
    cores = os.sched_getaffinity(0)
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=HERE / "target" / "peers",
                        help="the folder for models, answers and tables")
    parser.add_argument("--graph", type=Path,
                        help="a folder with a road graph, nodes.csv and edges.csv")
    parser.add_argument("--case", action="append", metavar="NAME",
                        help="only this case; may be given often; `families` stands for all with "
                        "a family of observations")
    parser.add_argument("--repetitions", type=int, default=9,
                        help="how often each routine is timed, 7 or more")
    parser.add_argument("--core", type=int, choices=sorted(cores), default=max(cores),
                        help="the core that all run on")
    parser.add_argument("--instructions", choices=["avx512", "avx2", "plain"],
                        help="the widest that wayfix takes")
    parser.add_argument("--beside", type=Path, action="append", default=[], metavar="FILE",
                        help="an earlier ratios.csv, of another machine or version, to compare "
                        "ratios with; may be given often")
    arguments = parser.parse_args()
    if arguments.repetitions < 7:
        parser.error("--repetitions: 7 or more")
    arguments.out = arguments.out.resolve()
    return arguments


# One core, one thread and doubles, before any of the libraries starts.
ARGUMENTS = parse_arguments()
subprocess.run(["cargo", "build", "--release", "--locked", "--quiet"], cwd=HERE, check=True)
os.sched_setaffinity(0, {ARGUMENTS.core})
for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
    os.environ[f"{library}_NUM_THREADS"] = "1"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
os.environ["JAX_PLATFORMS"] = "cpu"
os.environ["JAX_ENABLE_X64"] = "1"
if ARGUMENTS.instructions:
    os.environ["WAYFIX_INSTRUCTIONS"] = ARGUMENTS.instructions

import families  # noqa: E402
import many  # noqa: E402
import report  # noqa: E402
import switching  # noqa: E402
from libraries import of_dynamax, of_hmmlearn, of_scipy  # noqa: E402
from models import Case  # noqa: E402
from race import Contender, Times  # noqa: E402


def run_rust(case):
    """Times of wayfix and the crates: {(case, routine, who): numbers}."""
    command = [HERE / "target" / "release" / "peers", "--out", ARGUMENTS.out, "--case", case,
               "--repetitions", str(ARGUMENTS.repetitions)]
    if ARGUMENTS.graph:
        command += ["--graph", ARGUMENTS.graph]
    subprocess.run(command, check=True)
    numbers = ("median_us", "min_us", "max_us", "difference")
    with (ARGUMENTS.out / "times.csv").open() as file:
        return {(row["case"], row["routine"], row["who"]): [float(row[name]) for name in numbers]
                for row in csv.DictReader(file)}


def given(name, routines, libraries, times, out):
    """Compares the routines of a model with given likelihoods."""
    case = Case(out, name)
    offered = {who: library(case) for who, library in libraries.items()}
    for routine in routines:
        times.race(name, routine, {
            who: Contender(of[routine], case.sizes["steps"], case.check(routine))
            for who, of in offered.items() if routine in of})


def main():
    """Runs all cases, and prints and writes the table."""
    both = {"hmmlearn": of_hmmlearn, "dynamax": of_dynamax}
    scipy = {"scipy (CSR)": of_scipy}
    routines = ["forward", "score", "smooth", "viterbi"]
    cases = {
        "road map": partial(given, "road map", ["filter", *routines], both | scipy),
        "graph": partial(given, "graph", ["filter", "forward", "smooth"], scipy),
        "dense 105": None,  # bio and hmmm
        many.NAME: many.run,
        "two states": partial(given, "two states", routines, both),
        "dense 1000": partial(given, "dense 1000", routines, both),
    }
    cases |= {name: partial(switching.run, name)
              for name in (switching.REGRESSION, switching.WITH_INPUTS)}
    cases |= {name: partial(families.run, name) for name in families.NAMES}
    if not ARGUMENTS.graph:
        del cases["graph"]
    if ARGUMENTS.case:
        asked = set(ARGUMENTS.case)
        if "families" in asked:
            asked = asked - {"families"} | set(families.NAMES)
        if asked - set(cases):
            sys.exit(f"no case {', '.join(sorted(asked - set(cases)))}; there are "
                     f"{', '.join(cases)}, and families")
        cases = {name: run for name, run in cases.items() if name in asked}
    ARGUMENTS.out.mkdir(parents=True, exist_ok=True)
    rust, times = {}, Times(ARGUMENTS.repetitions)
    for name, run in cases.items():
        before = run_rust(name)
        if run:
            run(times, ARGUMENTS.out)
        rust |= report.both(before, run_rust(name))

    rows = list(report.ratios(rust, times.rows))
    # Read before this run overwrites the files of an earlier one.
    compared = "\n".join(report.beside(rows, ARGUMENTS.beside)) + "\n" if ARGUMENTS.beside else ""
    with (ARGUMENTS.out / "ratios.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(report.COLUMNS)
        writer.writerows(rows)
    table = "\n".join(report.markdown(rows))
    table += f"\n\n{report.setting(HERE, ARGUMENTS.repetitions)}\n"
    (ARGUMENTS.out / "ratios.md").write_text(table)
    print(table)
    if compared:
        (ARGUMENTS.out / "beside.md").write_text(compared)
        print(compared)


if __name__ == "__main__":
    main()
