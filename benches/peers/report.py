"""The table of ratios, and the machine and versions that it was measured with."""

import csv
import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

COLUMNS = ["case", "routine", "wayfix_us", "wayfix_min_us", "wayfix_max_us", "peer", "peer_us",
           "peer_min_us", "peer_max_us", "ratio", "ratio_of_min", "difference"]


def both(before, after):
    """Merges two runs: the mean of the medians, the least and the most."""
    return {key: ((before[key][0] + after[key][0]) / 2, min(before[key][1], after[key][1]),
                  max(before[key][2], after[key][2]), before[key][3]) for key in before}


def ratios(rust, python):
    """A row for each peer, in the order of wayfix's routines."""
    everyone = [(*key, *numbers) for key, numbers in rust.items()] + python
    routines = [key for key in rust if key[2] == "wayfix"]
    for case, routine, wayfix in routines:
        ours = rust[case, routine, wayfix]
        for *key, median, least, most, off in everyone:
            if key[:2] == [case, routine] and key[2] != wayfix:
                yield [case, routine, *ours[:3], key[2], median, least, most,
                       median / ours[0], least / ours[1], off]


def markdown(rows):
    """The lines of the table."""
    yield "| case | routine | wayfix µs | peer | peer µs | ratio | of the least | difference |"
    yield "|---|---|---|---|---|---|---|---|"
    for case, routine, *ours, who, median, least, most, ratio, of_least, off in rows:
        yield (f"| {case} | {routine} | {with_spread(*ours)} | {who} | "
               f"{with_spread(median, least, most)} | {ratio:.2f} | {of_least:.2f} | {off:.0e} |")


def with_spread(*numbers):
    """Median (least–most), with three digits."""
    median, least, most = (f"{x:.3g}" if x < 999.5 else f"{x:.0f}" for x in numbers)
    return f"{median} ({least}–{most})"


def setting(here, repetitions):
    """Machine, versions and repetitions."""
    rustc = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True)
    packages = (here / "Cargo.lock").read_text().split("[[package]]")[1:]
    crates = {part.split('"')[1]: part.split('"')[3] for part in packages}
    parts = [f"{name} {crates[name]}" for name in ("bio", "hmmm", "faer")]
    python = ("hmmlearn", "dynamax", "statsmodels", "jax", "numpy", "scipy")
    parts += [f"{name} {version(name)}" for name in python]
    chosen = os.environ.get("WAYFIX_INSTRUCTIONS", "")
    only = f"; wayfix with {chosen}" if chosen else ""
    return (f"One core of {processor()}{only}; {' '.join(rustc.stdout.split()[:2])}, CPython "
            f"{platform.python_version()}; {', '.join(parts)}. µs a step, median (least–most) of "
            f"{repetitions} repetitions; of wayfix and the crates so many before each case and "
            "after it.")


def processor():
    """Name, instructions and caches, as far as the system reports them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    # The entries of the first processor.
    of = {name.strip(): value.strip() for name, _, value in
          (line.partition(":") for line in reversed(lines))}
    name = of.get("model name") or platform.processor() or platform.machine()
    if "cpu family" in of:
        name += f" (family {of['cpu family']}, model {of['model']})"
    flags = of.get("flags", "").split()
    sets = [text for flag, text in (("avx512f", "AVX-512"), ("avx2", "AVX2")) if flag in flags]
    return ", ".join([name, *sets, *caches()])


def caches():
    """Data caches of the first core, from the smallest."""
    for index in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        level, kind, size = ((index / name).read_text().strip()
                             for name in ("level", "type", "size"))
        if kind != "Instruction":
            yield f"L{level} {size}"


def beside(rows, earlier):
    """Lines of a table of ratios from this run and earlier files, with the least and the most."""
    tables = [{tuple(row[:2]) + (row[5],): row[9] for row in rows}]
    for path in earlier:
        with path.open(newline="") as file:
            tables.append({(row["case"], row["routine"], row["peer"]): float(row["ratio"])
                           for row in csv.DictReader(file)})
    names = ["here", *map(str, earlier)]
    yield f"| case | routine | peer | {' | '.join(names)} | least | most |"
    yield "|" + "---|" * (len(names) + 5)
    for key in tables[0]:
        found = [table[key] for table in tables if key in table]
        cells = [f"{table[key]:.2f}" if key in table else "–" for table in tables]
        yield f"| {' | '.join([*key, *cells])} | {min(found):.2f} | {max(found):.2f} |"
