"""The table of ratios, and on what it was measured."""

import platform
import subprocess
from importlib.metadata import version

COLUMNS = ["case", "routine", "wayfix_us", "wayfix_min_us", "wayfix_max_us", "peer", "peer_us",
           "peer_min_us", "peer_max_us", "ratio", "ratio_of_min", "difference"]


def both(before, after):
    """Two runs as one: the mean of the medians, the least and the most."""
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
    python = ("hmmlearn", "dynamax", "jax", "numpy", "scipy")
    parts += [f"{name} {version(name)}" for name in python]
    return (f"One core of {processor()}; {' '.join(rustc.stdout.split()[:2])}, CPython "
            f"{platform.python_version()}; {', '.join(parts)}. µs a step, median (least–most) of "
            f"{repetitions} repetitions; of wayfix and the crates so many before each case and "
            "after it.")


def processor():
    """The processor's name, as far as the system tells."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as information:
            names = [line.split(":")[1].strip() for line in information
                     if line.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()
