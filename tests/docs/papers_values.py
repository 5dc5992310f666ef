"""``docs/papers-values.md``: numbers of every line of ``docs/papers.md``: ``python -m tests.docs.papers_values``.

The paper's number, the truth of the twin that flew, and ours with one standard deviation. All commands run, which takes
some twenty minutes; ``ROTORID_PAPERS`` names a folder that keeps them.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from tests.docs import papers_1, papers_2, papers_3, papers_4, papers_5
from tests.docs.papers_checks import USUAL, Line, Row, shown
from tests.docs.papers_page import PAGE, Runs, sections

VALUES = PAGE.with_name("papers-values.md")
PAPERS: Mapping[str, Sequence[Line]] = {
    f"Paper {number}": module.LINES
    for number, module in enumerate((papers_1, papers_2, papers_3, papers_4, papers_5), start=1)
}
HEAD = """# The five papers in numbers

Reference: what each line of [its page](papers.md) gives, next to print and to the vehicle that flew, with one standard
deviation. Other lines are checked for their content.
"""
COLUMNS = ("quantity", "paper", "truth", "ours", "rule")


def rows_of(line: Line, runs: Runs) -> list[Row]:
    runs.before(line.run)
    return line.rows(runs)


def values(runs: Runs) -> str:
    """The page."""
    parts = [HEAD]
    for paper, lines in PAPERS.items():
        title = next(title for title, _ in sections() if title.startswith(paper))
        parts.append(f"\n## {title}\n\n```text\n")
        for run, group in groupby(lines, key=lambda line: line.run):
            cells = [cell for line in group if not line.pending for cell in map(cells_of, rows_of(line, runs))]
            if cells:
                parts.append(block(run, list(dict.fromkeys(cells))))
        pending = [f"{line.run}, {line.item}: {line.pending}\n" for line in lines if line.pending]
        parts += ["does not hold yet:\n", *pending] if pending else []
        parts.append("```\n")
    return "".join(parts)


def cells_of(row: Row) -> tuple[str, ...]:
    numbers = ("" if one is None else f"{one:.4g}" for one in (row.paper, row.truth))
    return (row.what, *numbers, shown(row.ours), row.rule)


def block(run: str, cells: Sequence[tuple[str, ...]]) -> str:
    """Rows of a run below its name."""
    lines = [f"{what:<46}{paper:>10}{truth:>10}  {ours:<22}{rule}".rstrip() for what, paper, truth, ours, rule in cells]
    head = f"{run:<46}{'paper':>10}{'truth':>10}  {'ours':<22}rule"
    return "\n".join([head, *lines]) + "\n\n"


def usual_share(runs: Runs) -> float:
    """Share of the numbers with an interval that lie within two standard deviations."""
    lines = [line for lines in PAPERS.values() for line in lines if not line.pending]
    off = [row.off for line in lines for row in rows_of(line, runs) if row.off is not None]
    return sum(one <= USUAL for one in off) / len(off)


def main() -> None:
    """Run all commands and write the page."""
    with tempfile.TemporaryDirectory() as folder:
        VALUES.write_text(values(Runs(Path(os.environ.get("ROTORID_PAPERS", folder)))), encoding="utf-8")


if __name__ == "__main__":
    main()
