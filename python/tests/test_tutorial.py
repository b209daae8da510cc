"""The tutorial runs, draws its pictures, and recovers the truth of its simulations."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIAL = Path(__file__).parent.parent / "examples" / "tutorial.py"


def test_tutorial(tmp_path):
    pytest.importorskip("matplotlib")
    if not TUTORIAL.is_file():
        pytest.skip(f"{TUTORIAL} is not beside these tests")
    done = subprocess.run([sys.executable, str(TUTORIAL), str(tmp_path)], capture_output=True, text=True, check=False,
                          env=os.environ | {"MPLBACKEND": "Agg"})
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"weather.png", "regimes.png", "places.png", "noises.png", "roads.png"}
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in tmp_path.iterdir())
    recall = dict(re.findall(r"^(.+): recall within 2 ([\d.]+)", done.stdout, re.MULTILINE))
    assert float(recall["smoother"]) > 0.95 > float(recall["nearest image"])
    # At low noise, the filter has less recall at 100 % precision than the nearest image.
    rows = {row[0]: [*map(float, row[1:])] for row in map(str.split, re.findall(r"^ *\d\.\d(?: +\d\.\d\d){6}$", done.stdout, re.MULTILINE))}
    assert rows["1.2"][3] > rows["1.2"][4] and rows["2.6"][3] < rows["2.6"][4]
    assert all(row[2] > row[1] for row in rows.values()) and rows["2.6"][1] > rows["2.6"][0]
    assert int(re.search(r"(\d+)% right", done.stdout)[1]) > 90
    # The streets that the van and the bus drove.
    roads = dict(re.findall(r"^(van|bus) +(\d+)$", done.stdout, re.MULTILINE))
    assert int(roads["van"]) in range(13, 16) and int(roads["bus"]) in range(8, 11)
