"""Examples in the docstrings of what others use are run, so that they stay true."""

import doctest
import importlib

import pytest

EXAMPLES = (
    ("model.motion.motion", "Motion"),
    ("model.generation.base", "System"),
    ("model.sampling.samplers", "SamplerChoice"),
    ("model.formats.read", "read_any_motion"),
    ("app.notebook", "diagnose"),
    ("app.run.requests.requests", "GenerateRequest"),
    ("app.run.output.result_folder", "ResultFolder"),
)


@pytest.mark.parametrize(("module_name", "name"), EXAMPLES, ids=lambda each: each)
def test_examples_of_docstrings(module_name, name):
    module = importlib.import_module(module_name)
    tests = doctest.DocTestFinder(recurse=False).find(
        getattr(module, name), name, module, vars(module)
    )
    assert any(test.examples for test in tests)
    runner = doctest.DocTestRunner(verbose=False)
    assert all(runner.run(test).failed == 0 for test in tests)
