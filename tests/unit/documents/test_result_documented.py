"""``docs/results.md`` names every field of ``result.json``: scripts are written against them."""

from __future__ import annotations

import re
from pathlib import Path

from rotorid.documents.result import ResultDocument

DOCS = Path(__file__).resolve().parents[3] / "docs" / "results.md"


def test_every_field_of_a_result_stands_in_the_docs() -> None:
    schema = ResultDocument.model_json_schema(by_alias=True)
    fields = {name for part in (schema, *schema["$defs"].values()) for name in part["properties"]}
    chapter = DOCS.read_text(encoding="utf-8").partition("\n## `result.json`\n")[2].partition("\n## ")[0]
    named = set(re.findall(r"`([A-Za-z_0-9]+)`", chapter))
    assert len(fields) > 60
    assert fields <= named, f"name {sorted(fields - named)} in docs/results.md"
