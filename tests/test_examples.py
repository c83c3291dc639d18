"""The examples in the docstrings run, and show what they say."""

import doctest
import importlib
import pkgutil

import pytest

import pfslam

MODULES = [
    found.name
    for found in pkgutil.walk_packages(pfslam.__path__, "pfslam.")
    if not found.name.endswith("__main__")
]
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.mark.parametrize("name", [pytest.param("pfslam", marks=pytest.mark.slow), *MODULES])
def test_examples_run(name):
    module = importlib.import_module(name)
    failed, tried = doctest.testmod(module, optionflags=FLAGS)
    assert not failed, f"{failed} of {tried} examples in {name}"
