"""The browser, looked for once."""

from __future__ import annotations

import pytest
from tests.browser.chromium import browser


@pytest.fixture(scope="session")
def chromium() -> str:
    return browser()
