"""Write what the blocks of a tutorial print below them: ``python tests/docs/refill.py docs/tutorials/PAGE.md``.

For when numbers change on purpose. Look at the difference before it is kept: the text around the blocks speaks of it.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import re
import sys
import tempfile
from pathlib import Path

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def refilled(text: str) -> str:
    """A page with the output of its blocks, which run in order in one namespace."""
    scope: dict[str, object] = {}

    def block(match: re.Match[str]) -> str:
        examples = doctest.DocTestParser().get_examples(match[1])
        return "```python\n" + "".join(_ran(example.source, scope) for example in examples) + "```"

    return BLOCK.sub(block, text)


def _ran(source: str, scope: dict[str, object]) -> str:
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(source, "<tutorial>", "single"), scope)
    first, *others = source.splitlines()
    lines = [f">>> {first}", *(f"... {line}".rstrip() for line in others), *said.getvalue().rstrip().splitlines()]
    return "".join(f"{line.rstrip()}\n" for line in lines)


def main() -> None:
    pages = [Path(name).resolve() for name in sys.argv[1:]]
    for page in pages:
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            text = refilled(page.read_text(encoding="utf-8"))
            os.chdir(page.parent)
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
