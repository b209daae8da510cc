"""Examples in the docstrings of the modules for vehicles run, and each method has a docstring."""

import doctest
import inspect

import pytest
import wayfix
import wayfix.arrow
import wayfix.evaluate
import wayfix.learning
import wayfix.matching
import wayfix.recognition

PUBLIC = [(wayfix, "FixedLag")] + [
    (module, name)
    for module in (wayfix.arrow, wayfix.evaluate, wayfix.learning, wayfix.matching, wayfix.recognition)
    for name in module.__all__
]


@pytest.mark.parametrize(("module", "name"), PUBLIC, ids=[name for _, name in PUBLIC])
def test_docstrings(module, name):
    public = getattr(module, name)
    examples = doctest.DocTestFinder(recurse=False).find(public, name, module=False, globs={})
    runner = doctest.DocTestRunner()
    for example in examples:
        assert runner.run(example).failed == 0
    assert public.__doc__
    if isinstance(public, type):
        fields = public.__doc__.partition("Attributes")[2].replace(", ", " : \n")
        for method in [method for method in vars(public) if not method.startswith("_")]:
            found = inspect.getattr_static(public, method).__doc__ or f"\n{method} : " in fields
            assert found, f"{name}.{method}"
