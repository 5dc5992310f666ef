"""Predictions of anybody: what is wrong with them is said before anything is computed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.benchmarking.foreign import foreign_predictions, table_of
from rotorid.errors import UsageError

ROWS = [("one", 2), ("two", 1)]


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_are_those_of_the_flights_in_their_order(tmp_path: Path) -> None:
    path = written(tmp_path, "b [N],a [N]\n10,1\n20,2\n30,3\n")
    one, two = table_of(path, ("a", "b"), ROWS)
    np.testing.assert_array_equal(one, [[1.0, 2.0], [10.0, 20.0]])
    np.testing.assert_array_equal(two, [[3.0], [30.0]])


def test_a_column_flight_says_whose_rows_they_are(tmp_path: Path) -> None:
    path = written(tmp_path, "flight,a\ntwo,3\none,1\none,2\n")
    one, two = table_of(path, ("a",), ROWS)
    assert (one.tolist(), two.tolist()) == ([[1.0, 2.0]], [[3.0]])


@pytest.mark.parametrize("text", ['"flight","a"\n"one",1\n"one",2\n"two",3\n', "flight, a\none ,1\n one,2\ntwo,3\n"])
def test_names_of_flights_may_be_quoted_or_have_spaces(tmp_path: Path, text: str) -> None:
    one, two = table_of(written(tmp_path, text), ("a",), ROWS)
    assert (one.tolist(), two.tolist()) == ([[1.0, 2.0]], [[3.0]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("b\n1\n2\n3\n", "mine.csv has no column a; expected a in its header"),
        ("a\n1\n2\n", "mine.csv has 2 rows; expected 3: 2 of one and 1 of two"),
        ("flight,a\none,1\ntwo,2\n", "mine.csv has 1 rows of one; expected 2"),
        ("a\n1\nnan\n3\n", "mine.csv has no number in column a of row 3; expected a finite number in each cell"),
        ("a\n1\nx\n3\n", "mine.csv has a cell that is no number"),
        ("", "mine.csv has no column a"),
        ("flight,a\n", "mine.csv has 0 rows of one; expected 2"),
        (f"a,{'b' * 140_000}\n", "mine.csv has no header (Error: field larger than field limit"),
    ],
)
def test_a_wrong_file_is_refused_in_words(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(UsageError) as error:
        table_of(written(tmp_path, text), ("a",), ROWS)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nowhere.csv", "'nowhere.csv' cannot be read"),
        ("mine.txt", "'mine.txt' is no CSV file and no function"),
        ("no_such_module:f", "the module 'no_such_module' cannot be imported"),
        ("json:dumb", "the module 'json' has no function 'dumb'"),
    ],
)
def test_predictions_that_do_not_exist(text: str, words: str) -> None:
    with pytest.raises(UsageError) as error:
        foreign_predictions(text)
    assert words in str(error.value)


def test_a_module_of_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_bench_model.py").write_text("def predict(task, training):\n    return 1\n")
    monkeypatch.chdir(tmp_path)
    found = foreign_predictions("my_bench_model:predict", "mine")
    assert (found.label, found.path) == ("mine", None)
    assert found.function is not None
    assert found.function(None, ()) == 1


def test_a_module_with_a_fault_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_broken_model.py").write_text("1 / 0\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"'my_broken_model' cannot be imported \(ZeroDivisionError"):
        foreign_predictions("my_broken_model:predict")
