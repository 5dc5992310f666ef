"""A normal run prints the first few rows and the worst few findings; ``-v`` prints all."""

from __future__ import annotations

import pytest
from rich.table import Table

from rotorid.cli.console import print_findings, print_lines, print_table
from rotorid.data.findings import Finding, refusal, remark, warn

GAPS = [warn("gap", f"channel {number}", f"{number}.5 s are missing.") for number in range(9)]
CLOCK = warn("clock_skew", "p", "p is 5 ms late.")
WORDS = remark("trim", "theta", "The vehicle flew forward.")


def printed(capsys: pytest.CaptureFixture[str], findings: list[Finding], *, verbose: bool = False) -> list[str]:
    print_findings(findings, verbose=verbose)
    return capsys.readouterr().out.splitlines()


def test_findings_fold_into_a_line_that_counts_them(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys, [*GAPS, CLOCK, WORDS])
    # The worst of each kind, and how many of its kind there are.
    assert lines == [
        "warning gap (worst of 9): 8.5 s are missing.",
        "warning clock_skew: p is 5 ms late.",
        "8 more warnings: -v shows all, or open report.html",
    ]


def test_the_worst_of_a_kind_has_the_largest_percentage(capsys: pytest.CaptureFixture[str]) -> None:
    shares = [
        warn("off_axis_input", name, f"roll moved by {share} % of {name} (0.0583 rms, 900 s).")
        for name, share in (("pitch", 51), ("yaw", 71), ("thrust", 9))
    ]
    lines = printed(capsys, [*shares, *(warn(f"kind_{place}", "p", f"Fact {place}.") for place in range(3))])
    assert lines[0] == "warning off_axis_input (worst of 3): roll moved by 71 % of yaw (0.0583 rms, 900 s)."


def test_what_has_one_remedy_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    slow = [warn("rate_too_low", name, f"{name} has 5 Hz, too slow for this; set LOG_BITMASK.") for name in "ABC"]
    (line,) = printed(capsys, slow)
    assert line == "warning rate_too_low: A has 5 Hz, B has 5 Hz and C has 5 Hz, too slow for this; set LOG_BITMASK."


def test_findings_that_fit_are_not_merged(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, GAPS[:3]) == [f"warning gap: {place}.5 s are missing." for place in range(3)]


def test_a_verbose_run_prints_every_finding_and_every_remark(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys, [*GAPS, CLOCK, WORDS], verbose=True)
    assert len(lines) == 11
    assert lines[-1] == "info trim: The vehicle flew forward."


def test_a_finding_of_several_places_is_printed_once_with_its_count(capsys: pytest.CaptureFixture[str]) -> None:
    again = warn("clock_skew", "q", CLOCK.message)
    assert printed(capsys, [CLOCK, again, CLOCK]) == ["warning clock_skew (3 times): p is 5 ms late."]


def test_errors_go_before_warnings(capsys: pytest.CaptureFixture[str]) -> None:
    error = Finding(kind="no_excitation", severity="error", where="p", message="Nothing moved.")
    assert printed(capsys, [*GAPS, error])[0] == "error no_excitation: Nothing moved."


def test_no_error_folds(capsys: pytest.CaptureFixture[str]) -> None:
    errors = [refusal("no_excitation", f"input {number}", f"Input {number} did not move.") for number in range(7)]
    lines = printed(capsys, [*GAPS, *errors])
    assert [line.partition(":")[0] for line in lines] == [
        *["error no_excitation"] * 7,
        "warning gap (worst of 9)",
        "8 more warnings",
    ]


@pytest.mark.parametrize(
    ("rows", "lines"), [(3, ["0", "1", "2"]), (4, ["0", "1", "2 more rows: -v shows all, or open page.html"])]
)
def test_a_table_folds_but_not_for_a_single_row(
    rows: int, lines: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    table = Table(box=None, show_header=False, pad_edge=False)
    print_table(table, [(str(row),) for row in range(rows)], verbose=False, most=2, page="page.html")
    assert [line.strip() for line in capsys.readouterr().out.splitlines()] == lines


def test_lines_fold_without_a_page(capsys: pytest.CaptureFixture[str]) -> None:
    print_lines(["a [b]", "c", "d", "e"], verbose=False, item="topic", most=1, page="")
    assert capsys.readouterr().out.splitlines() == ["a [b]", "3 more topics: -v shows all"]
