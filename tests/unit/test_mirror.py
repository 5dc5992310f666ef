"""Unit tests are found by the name of the module: every one is named after a module that lives, and needs it."""

from __future__ import annotations

from pathlib import PurePosixPath

import pytest
from tests.quick import Tree, distances, read_tree

EXCEPTIONS = {
    "tests/unit/test_mirror.py": "it is about all of them",
}
"""Unit tests that are named after no module, and why."""


@pytest.fixture(scope="module")
def tree() -> Tree:
    return read_tree()


def test_every_unit_test_is_named_after_a_module(tree: Tree) -> None:
    """``tests/unit/PACKAGE/test_MODULE.py``, or ``test_MODULE_ASPECT.py``."""
    units = {test: file.path for test, file in tree.files.items() if file.path.startswith("tests/unit/")}
    orphans = {path for test, path in units.items() if tree.files[test].is_test and tree.mirrors[test] is None}
    assert orphans == EXCEPTIONS.keys()


def test_a_unit_test_needs_the_module_that_it_is_named_after(tree: Tree) -> None:
    strangers = {
        test: module
        for test, module in tree.mirrors.items()
        if module is not None and module not in distances(tree.imports, [test])
    }
    assert strangers == {}


def test_what_tests_share_is_in_the_folder_of_a_package(tree: Tree) -> None:
    folders = {PurePosixPath(file.path).parent for file in tree.files.values() if file.path.startswith("tests/unit/")}
    packages = {PurePosixPath(file.path).parent for file in tree.files.values() if file.path.endswith("/__init__.py")}
    assert {PurePosixPath("src/rotorid") / folder.relative_to("tests/unit") for folder in folders} <= packages
