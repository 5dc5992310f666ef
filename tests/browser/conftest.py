"""The browser, started once for all tests in a row that need it, and labs that tests share as they change nothing."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from tests.browser.chromium import browser, started
from tests.browser.lab_page import TOKEN, LabPage, example_log, opened, serving

HERE = Path(__file__).resolve().parent
_browsers: list[Any] = []
_open = ExitStack()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> Generator[None, None, None]:
    """Close the browser behind the last of these tests: while it is open, no other has a loop of events of its own."""
    yield
    if nextitem is None or HERE not in nextitem.path.parents:
        _browsers.clear()
        _open.close()


@pytest.fixture(scope="module")
def shared_browser() -> Any:
    """A browser that reaches files and this machine; what belongs to a test is a context of its own."""
    if not _browsers:
        _browsers.append(_open.enter_context(started(browser())))
    return _browsers[0]


@pytest.fixture(scope="module")
def alone(shared_browser: Any) -> Any:
    """The browser for pages that reach nothing but themselves."""
    return shared_browser


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return example_log(tmp_path_factory)


@pytest.fixture(scope="module")
def served(example: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a lab that shows the example to everybody, and carries nothing out."""
    with serving(example, private=tmp_path_factory.mktemp("private"), token=TOKEN) as (address, _):
        yield address


@pytest.fixture
def looking(shared_browser: Any, served: str) -> Iterator[LabPage]:
    """A page of its own, in the lab where nothing is carried out."""
    with opened(shared_browser, served) as lab:
        lab.wait_for_tracks()
        yield lab
