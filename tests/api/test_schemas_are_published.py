"""The schemas in the docs are those of the typed documents."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.documents.schemas import SCHEMAS, schema_text

DOCS = Path(__file__).resolve().parents[2] / "docs" / "schemas"


@pytest.mark.parametrize("name", SCHEMAS)
def test_published_schema_is_current(name: str) -> None:
    published = (DOCS / f"{name}.json").read_text(encoding="utf-8")
    assert published == schema_text(name), f"regenerate docs/schemas/{name}.json from rotorid.documents.schemas"
