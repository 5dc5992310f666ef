"""The schemas in the docs are those of the typed documents; run as a module this writes them."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.documents.schemas import SCHEMAS, schema_text

DOCS = Path(__file__).resolve().parents[2] / "docs" / "schemas"


@pytest.mark.parametrize("name", SCHEMAS)
def test_published_schema_is_current(name: str) -> None:
    published = (DOCS / f"{name}.json").read_text(encoding="utf-8")
    assert published == schema_text(name), "renew the schemas: python -m tests.api.test_schemas_are_published"


if __name__ == "__main__":
    for written in SCHEMAS:
        (DOCS / f"{written}.json").write_text(schema_text(written), encoding="utf-8")
