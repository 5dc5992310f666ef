"""Every sentence that a person may read, and the constructions that none of them may use.

``python -m tests.phrases [PATH ...]`` lists what is found below the paths, ``--count`` the number per file.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.sources import nodes

ROOT = Path(__file__).resolve().parents[1]

FORBIDDEN = {
    "tell": r"\b(?:told|tells?|telling|untold)\b",
    "needed": r"; needed:",
    "came": r"\bcame\b(?! (?:from|with|back|to|in|out)\b)",
    "hold": r"\b(?:holds|held)\b(?! (?:its|the|their) (?:value|last|attitude|altitude|height|position|heading|place))",
    "of it": r"\b(?:of it|of itself|of which|that which|in which case)\b",
    "stand": r"\b(?:stands?|stood) (?:in|below|above|there|beside|under|at|on)\b|\b(?:below|above) stands?\b",
    "beside": r"\bbeside\b",
    "rest": r"\b(?:rests|rested)\b",
    "give way": r"\bg(?:ives?|iving|ave) way\b",
    "be moved": r"\bmoved by \d|\bmoves? by \{",
    "say": r"\b(?:say|says|said) (?:whether|what|so|which|that)\b",
    "what": r"(?:^|[.:;] )What (?:\w+ ){1,4}(?:is|are|was|were) (?:\w+)\.",
    "no better than": r"\bknown to no better than\b",
    "well": r"\b(?:is|are) well\b",
    "as far as": r"\bas far as\b",
    "once": r"\b(?:hardly|whither|thereof|therein|whereof|henceforth|anew)\b",
    "for one": r"\b(?:to speak of|by hand of|in turn of|gets lost)\b",
}
"""Constructions of a translated idiom: a name, and the pattern that finds it."""
PATTERNS = {name: re.compile(pattern) for name, pattern in FORBIDDEN.items()}


class Phrase(NamedTuple):
    """A text, with its place in the project."""

    path: str
    line: int
    text: str

    def faults(self) -> list[str]:
        """Names of the forbidden constructions that the text uses."""
        return [name for name, pattern in PATTERNS.items() if pattern.search(self.text)]


def _literal(node: ast.expr) -> str | None:
    """The text of a string or f-string, each value in it as ``{}``."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
    return None


def _of_python(path: Path) -> Iterator[Phrase]:
    """Strings of two words and more that are no docstring."""
    inner = {id(part) for node in nodes(path) if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
    inner -= {id(node) for node in nodes(path) if isinstance(node, ast.JoinedStr)}
    inner |= {id(node.value) for node in nodes(path) if isinstance(node, ast.Expr)}
    for node in nodes(path):
        if id(node) in inner or not isinstance(node, ast.expr):
            continue
        text = _literal(node)
        if text and re.search(r"[a-z]{2,} +[a-z{]", text):
            yield Phrase(str(path.relative_to(ROOT)), node.lineno, " ".join(text.split()))


def _of_template(path: Path) -> Iterator[Phrase]:
    """Lines of a template without its tags and statements."""
    text = re.sub(
        r"\{#.*?#\}", lambda found: "\n" * found.group().count("\n"), path.read_text(encoding="utf-8"), flags=re.S
    )
    for k, line in enumerate(text.splitlines(), 1):
        shown = " ".join(re.sub(r"<[^>]*>|\{%.*?%\}", " ", line).split())
        if re.search(r"[a-z]{2,} +[a-z{]", shown):
            yield Phrase(str(path.relative_to(ROOT)), k, shown)


def _of_script(path: Path) -> Iterator[Phrase]:
    """Strings of JavaScript; comments are no text for a reader."""
    for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        for found in re.finditer(r"\"((?:[^\"\\]|\\.)*)\"|`((?:[^`\\]|\\.)*)`", re.sub(r"^\s*(?://|/?\*).*", "", line)):
            text = found.group(1) or found.group(2) or ""
            if re.search(r"[a-z]{2,} +[a-z{]", text):
                yield Phrase(str(path.relative_to(ROOT)), k, text)


def _of_page(path: Path) -> Iterator[Phrase]:
    """Lines of a documentation page outside of code."""
    inside = False
    for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if line.lstrip().startswith("```"):
            inside = not inside
        elif not inside and line.strip():
            yield Phrase(str(path.relative_to(ROOT)), k, re.sub(r"`[^`]*`", "`code`", line))


READERS = {".py": _of_python, ".html": _of_template, ".js": _of_script, ".md": _of_page}


def phrases(*places: Path) -> Iterator[Phrase]:
    """All phrases of the files at or below some places."""
    for place in places:
        for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if path.suffix in READERS and not {"vendor", "__pycache__"} & set(path.parts) and ".min." not in path.name:
                yield from READERS[path.suffix](path)


def main() -> None:
    """List the faults."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path)
    parser.add_argument("--count", action="store_true")
    asked = parser.parse_args()
    places = [path.resolve() for path in asked.paths] or [ROOT / "src", ROOT / "docs", ROOT / "README.md"]
    found = [(phrase, faults) for phrase in phrases(*places) if (faults := phrase.faults())]
    if asked.count:
        for path, number in Counter(phrase.path for phrase, _ in found).most_common():
            print(f"{number:5} {path}")
        print(f"{len(found):5} in all")
        print(Counter(fault for _, faults in found for fault in faults).most_common())
        return
    for phrase, faults in found:
        print(f"{phrase.path}:{phrase.line}: [{', '.join(faults)}] {phrase.text[:300]}")


if __name__ == "__main__":
    main()
