"""Examples of docstrings and README run; the types of the compiled part are right."""

import doctest
import subprocess
import sys
from pathlib import Path

import pytest
import wayfix
import wayfix._wayfix

HERE = Path(__file__).parent.parent


@pytest.mark.parametrize("name", ["Hmm", "Filter"])
def test_docstrings(name):
    finder = doctest.DocTestFinder(recurse=False)
    examples = finder.find(getattr(wayfix, name), name, module=False, globs={})
    assert any(example.examples for example in examples)
    runner = doctest.DocTestRunner()
    for example in examples:
        assert runner.run(example).failed == 0


def test_readme():
    assert doctest.testfile(str(HERE / "README.md"), module_relative=False).failed == 0


def test_every_public_method_is_documented():
    for name in wayfix.__all__:
        public = getattr(wayfix, name)
        if isinstance(public, type):
            assert public.__doc__, name
            for method in [m for m in vars(public) if not m.startswith("_")]:
                # Attributes of exceptions and results are documented in the class's docstring.
                if name not in ("Error", "Path", "Smoothed"):
                    assert getattr(public, method).__doc__, f"{name}.{method}"


@pytest.mark.parametrize("command", [
    ["mypy", "--strict", "--follow-imports=silent", str(HERE / "tests" / "typed.py")],
    ["mypy.stubtest", "wayfix._wayfix", "--ignore-missing-stub"],
])
def test_types(command):
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, check=False,
                          cwd=HERE)
    assert done.returncode == 0, done.stdout + done.stderr
