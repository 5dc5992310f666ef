"""``make quick`` chooses the tests of a change: by faces, tables and whatever stands between, the nearest first.

What it relies on: every unit test is named after a module that lives, and needs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

import pytest
from tests.quick import BUDGET_S, SHORT_S, Choice, Tree, distances, durations_of, mirrored, read_tree

FILES = {
    "src/rotorid/__init__.py": "from rotorid._faces import lazy\n",
    "src/rotorid/__init__.pyi": "from rotorid.flights import fly as fly\n",
    "src/rotorid/_faces.py": "",
    "src/rotorid/flights/__init__.py": "",
    "src/rotorid/flights/__init__.pyi": "from rotorid.flights.airborne import fly as fly\n",
    "src/rotorid/flights/airborne.py": "def fly():\n    from rotorid.flights import wind\n",
    "src/rotorid/flights/wind.py": "import typing\nif TYPE_CHECKING:\n    from rotorid.flights import airborne\n",
    "src/rotorid/flights/gusts.toml": "",
    "src/rotorid/cli/__init__.py": "",
    "src/rotorid/cli/app.py": "def load(name):\n    return f'rotorid.cli.{name}'\n",
    "src/rotorid/cli/hover.py": "READERS = ('rotorid.flights.wind:speed',)\n",
    "src/rotorid/cli/land.py": "'''Says nothing of rotorid.flights.wind.'''\n",
    "tests/conftest.py": "import rotorid.flights.airborne\n",
    "tests/unit/commands.py": "from rotorid.cli.app import load\n",
    "tests/unit/test_face.py": "from rotorid import fly\n",
    "tests/unit/test_chain.py": "import rotorid\nrotorid.flights.fly()\n",
    "tests/unit/test_command.py": "from tests.unit.commands import load\nload('hover')\n",
    "tests/unit/test_data.py": "NAME = 'flights/gusts.toml'\n",
    "tests/unit/test_later.py": "import rotorid.flights.wind\npytestmark = pytest.mark.slow\n",
    "tests/unit/flights/test_wind_from_north.py": "",
    "tests/twins/test_wind.py": "import rotorid.flights.wind\n",
}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Tree:
    root = tmp_path_factory.mktemp("repository")
    for name, text in FILES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    return read_tree(root)


@pytest.fixture(scope="module")
def tree() -> Tree:
    return read_tree()


@pytest.fixture(scope="module")
def choices(tree: Tree) -> Mapping[str, Choice]:
    """Each file of the package, and what is chosen when it alone changes."""
    return {file.path: tree.choose([file.path]) for file in tree.files.values() if file.path.startswith("src/")}


def test_a_name_of_a_face_needs_the_module_that_defines_it(small: Tree) -> None:
    assert {"rotorid", "rotorid.flights", "rotorid.flights.airborne"} <= small.imports["tests.unit.test_face"]
    assert "rotorid.flights.airborne" in small.imports["tests.unit.test_chain"]


def test_strings_name_modules_and_documentation_does_not(small: Tree) -> None:
    assert "rotorid.flights.wind" in small.imports["rotorid.cli.hover"]
    assert "rotorid.flights.wind" not in small.imports["rotorid.cli.land"]


def test_imports_of_functions_count_and_those_for_types_do_not(small: Tree) -> None:
    assert "rotorid.flights.wind" in small.imports["rotorid.flights.airborne"]
    assert "rotorid.flights.airborne" not in small.imports["rotorid.flights.wind"]


def test_a_table_needs_all_its_modules_and_a_test_those_that_it_names(small: Tree) -> None:
    assert {"rotorid.cli.hover", "rotorid.cli.land"} <= small.imports["rotorid.cli.app"]
    assert "rotorid.cli.hover" in small.imports["tests.unit.test_command"]
    assert "rotorid.cli.land" not in small.imports["tests.unit.test_command"]


def test_the_nearest_come_first_and_long_and_slow_ones_not_at_all(small: Tree) -> None:
    choice = small.choose(["src/rotorid/flights/wind.py"])
    chosen = choice.chosen
    assert chosen[0] == "tests/unit/flights/test_wind_from_north.py"
    assert {"tests/unit/test_command.py", "tests/unit/test_face.py"} <= set(chosen)
    assert not {"tests/unit/test_later.py", "tests/twins/test_wind.py"} & set(chosen)
    assert choice.left_out == ("tests/twins/test_wind.py",)


def test_a_changed_test_is_chosen_wherever_it_is(small: Tree) -> None:
    assert small.choose(["tests/twins/test_wind.py"]).chosen == ("tests/twins/test_wind.py",)


def test_data_belong_to_those_that_name_them(small: Tree) -> None:
    assert small.choose(["src/rotorid/flights/gusts.toml"]).chosen == ("tests/unit/test_data.py",)
    assert small.choose(["README.md"]).chosen == ()


def test_the_budget_leaves_out_what_is_far(small: Tree) -> None:
    choice = small.choose(["src/rotorid/flights/wind.py"], budget_s=1.0)
    assert len(choice.chosen) == 2
    assert choice.left_out
    assert not set(choice.chosen) & set(choice.left_out)


def test_durations_are_those_of_a_report(tmp_path: Path) -> None:
    report = tmp_path / "report.xml"
    case = '<testcase classname="tests.unit.near.test_{}" name="x" time="{}"/>'
    report.write_text(f"<a>{case.format('csv', 0.9)}{case.format('csv', 0.4)}{case.format('npz', 0.1)}</a>", "utf-8")
    assert durations_of(report) == {"tests/unit/near/test_csv.py": 1.3}


@pytest.mark.parametrize(
    ("module", "test"),
    [
        ("cli/compare", "cli/test_compare_command"),  # a command, which its table loads
        ("exports/json_model", "exports/test_json_model"),  # a target of the same kind
        ("fleets/worker", "fleets/test_runs"),  # started as a process
        ("flights/supports", "flights/test_supports"),
        ("identifying/nonlinear", "identifying/test_nonlinear"),  # reached by a table of methods
        ("io/ardupilot/text", "io/ardupilot/test_text"),  # a format, named in a string
        ("io/sandbox_worker", "io/test_sandbox"),  # started as a process
        ("io/tables/steps", "io/tables/test_steps"),  # steps of a mapping
        ("lab/connections", "lab/test_connections"),
        ("search/acceleration_kernels", "search/test_acceleration"),
        ("signal/stretch", "identifying/test_tracking"),
    ],
)
def test_the_tests_of_a_module_are_among_the_first(choices: Mapping[str, Choice], module: str, test: str) -> None:
    assert f"tests/unit/{test}.py" in choices[f"src/rotorid/{module}.py"].chosen[:3]


def test_every_module_chooses_a_test(choices: Mapping[str, Choice]) -> None:
    assert [path for path, choice in choices.items() if not choice.chosen] == []


def test_a_test_named_after_a_module_is_chosen_for_it_first(tree: Tree, choices: Mapping[str, Choice]) -> None:
    for test, module in tree.mirrors.items():
        if module is not None and not tree.files[test].slow:
            choice = choices[tree.files[module].path]
            assert tree.files[test].path in choice.chosen + choice.left_out
            assert mirrored(choice.chosen[0], tree.files) == module


def test_what_is_chosen_fits_into_the_budget(tree: Tree, choices: Mapping[str, Choice]) -> None:
    for path, choice in choices.items():
        cost_s = sum(tree.durations_s.get(one, SHORT_S) for one in choice.chosen)
        assert len(choice.chosen) == 1 or cost_s <= BUDGET_S, path


def test_every_unit_test_is_named_after_a_module(tree: Tree) -> None:
    """``tests/unit/PACKAGE/test_MODULE.py``, or ``test_MODULE_ASPECT.py``."""
    units = {test: file for test, file in tree.files.items() if file.path.startswith("tests/unit/") and file.is_test}
    assert len(units) > 500
    assert [file.path for test, file in units.items() if tree.mirrors[test] is None] == []


def test_a_unit_test_needs_the_module_that_it_is_named_after(tree: Tree) -> None:
    strangers = {
        test: module
        for test, module in tree.mirrors.items()
        if module is not None and module not in distances(tree.imports, [test])
    }
    assert strangers == {}


def test_what_tests_share_is_in_the_folder_of_a_package(tree: Tree) -> None:
    folders = {PurePosixPath(file.path).parent for file in tree.files.values() if file.path.startswith("tests/unit/")}
    packages = {PurePosixPath(file.path).parent for file in tree.files.values() if file.path.endswith("/__init__.py")}
    assert {PurePosixPath("src/rotorid") / folder.relative_to("tests/unit") for folder in folders} <= packages
