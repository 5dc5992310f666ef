"""The browser, looked for once, and labs that tests share because they change nothing in them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.browser.chromium import browser, started
from tests.browser.lab_page import TOKEN, LabPage, example_log, opened, serving
from tests.browser.lab_page import chromium as started_chromium


@pytest.fixture(scope="session")
def chromium() -> str:
    return browser()


@pytest.fixture(scope="module")
def alone(chromium: str) -> Iterator[Any]:
    """A browser that reaches nothing but files."""
    with started(chromium) as opened:
        yield opened


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return example_log(tmp_path_factory)


@pytest.fixture(scope="module")
def shared_browser() -> Iterator[Any]:
    with started_chromium() as opened:
        yield opened


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
