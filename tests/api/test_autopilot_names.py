"""Who asks for an autopilot by its name: every such place outside the rooms of the autopilots is counted.

Counted is each name of an autopilot, of its log format or of a parameter that gives it away, where code decides by it:
in a comparison (``==``, ``in``, ``is``), a ``case``, ``startswith`` and its like, as a key of a table, in a list of
several or in a ``Literal``; as text, or as a constant that stands for it (``BETAFLIGHT``). What a message says, what a
doctest makes and which file is written are not counted.

Rooms, which may name what is theirs:

- ``autopilots``, where all that is known of an autopilot is gathered;
- ``models/autopilots``, their controllers;
- modules and packages with an autopilot in their own name: ``io/px4``, ``vehicles/betaflight.py``;
- ``io/mavlink``, whose messages say who sends them.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Set
from types import MappingProxyType

from tests.sources import SOURCE, parts, syntax

ROOM = re.compile(r"(^|/)(autopilots|mavlink|[a-z0-9_]*(px4|ardupilot|betaflight|crazyflie)[a-z0-9_]*)(/|\.py$)")
NAMED = re.compile(
    r"(ardupilot|arducopter|px4|betaflight|cleanflight|inav|crazyflie|mavlink|dataflash|ulog|blackbox)\b|(ulg|bin|bbl)$",
    re.IGNORECASE,
)
SIGNS = frozenset(("MC_ROLLRATE_P", "ATC_RAT_RLL_P", "rollPID_P"))
CONSTANT = re.compile(r"_?(PX4|ARDUPILOT|BETAFLIGHT|CRAZYFLIE|MAVLINK)")
ASKING = frozenset(("startswith", "endswith", "removeprefix", "removesuffix"))

ALLOWED: Mapping[str, tuple[int, str]] = MappingProxyType(
    {
        "cli/help.py:module": (2, "examples of calls, which are typed"),
        "data/synonyms.py:module": (4, "words that people use for targets of export, two of which are autopilots"),
        "fleets/identity.py:board_of": (
            3,
            "tries three patterns for the number of a board, of which no other room may know",
        ),
        "flying/settings.py:SimulateSettings.__post_init__": (
            1,
            "one format names no rotors, so that their order is checked",
        ),
        "flying/user_vehicles.py:_logged": (2, "parameters of rotors are made of layouts and of the library of frames"),
        "io/formats.py:module": (3, "the table of formats that are written"),
        "lab/steps.py:Step": (2, "targets of export, of which two are simulators of autopilots"),
        "plans/files.py:plan_files": (3, "the table of the rooms that write plans"),
        "simulation/autopilot.py:module": (3, "a type of the controllers that are simulated, for type checkers"),
        "tuning/files.py:parameter_files": (3, "the table of texts by which gains reach a vehicle"),
    }
)
"""Places that stay, how many names each has, and why."""


def is_name(node: ast.AST, constants: Set[str]) -> int:
    """How many autopilots an expression names."""
    if isinstance(node, ast.Constant):
        return int(isinstance(node.value, str) and (node.value in SIGNS or NAMED.match(node.value) is not None))
    if isinstance(node, ast.Name | ast.Attribute):
        name = node.id if isinstance(node, ast.Name) else node.attr
        return int(name in constants or CONSTANT.fullmatch(name) is not None)
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return sum(is_name(each, constants) for each in node.elts)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "frozenset":
        return sum(is_name(each, constants) for each in node.args)
    return 0


def is_sign(node: ast.AST) -> bool:
    """Whether an expression is a parameter, which a table of parameters has as a matter of course."""
    return isinstance(node, ast.Constant) and node.value in SIGNS


def asked(node: ast.AST, constants: Set[str]) -> int:
    """How many names of autopilots a node decides by."""
    if isinstance(node, ast.Compare):
        return sum(is_name(each, constants) for each in (node.left, *node.comparators))
    if isinstance(node, ast.MatchValue):
        return is_name(node.value, constants)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in ASKING:
        return sum(is_name(each, constants) for each in node.args)
    if isinstance(node, ast.Dict):
        return sum(is_name(key, constants) for key in node.keys if key is not None and not is_sign(key))
    if isinstance(node, ast.Tuple | ast.List | ast.Set) and isinstance(getattr(node, "ctx", ast.Load()), ast.Load):
        named = sum(
            is_name(each, constants) for each in node.elts if not isinstance(each, ast.Tuple) and not is_sign(each)
        )
        # A list of autopilots decides who is none; a single name among other words does not.
        return named if named > 1 else 0
    return 0


def places(tree: ast.Module) -> Iterator[str]:
    """The function of each name, once for each."""
    constants = {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name) and is_name(node.value, frozenset())
    }

    rest: list[tuple[ast.AST, str]] = [(tree, "module")]
    while rest:
        node, where = rest.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            where = node.name if where == "module" else f"{where}.{node.name}"
        count = asked(node, constants)
        yield from [where] * count
        # What a comparison names is counted with it.
        counted = (ast.Tuple, ast.List, ast.Set) if count and not isinstance(node, ast.Dict) else ()
        rest += [(child, where) for child in parts(node) if not isinstance(child, counted)]


def found() -> Counter[str]:
    """Places, ``file:function``, to the number of names there."""
    counts: Counter[str] = Counter()
    for file in sorted(SOURCE.rglob("*.py")):
        path = file.relative_to(SOURCE).as_posix()
        if not ROOM.search(path):
            counts.update(f"{path}:{where}" for where in places(syntax(file)))
    return counts


def test_the_counter_sees_every_way_of_asking() -> None:
    text = """
OWN = "PX4"
ALL = ("PX4", "ArduPilot")
TABLE: Mapping[str, int] = {"px4": 1, "other": 2}
Kind: TypeAlias = Literal["px4", "betaflight", "simple"]
def by(record):
    if record.format.startswith(("ArduPilot", "MAVLink")) or record.name in ALL or "MC_ROLLRATE_P" in record:
        raise Error("Betaflight came")
    match record.name:
        case "Betaflight" | "Crazyflie":
            return named == OWN
    return named is autopilots.BETAFLIGHT or path == "px4_quad"
"""
    assert Counter(places(ast.parse(text))) == {"module": 5, "by": 8}


def test_autopilots_are_asked_for_by_name_in_few_places() -> None:
    counts = found()
    assert {place: count for place, count in counts.items() if count > ALLOWED.get(place, (0, ""))[0]} == {}, (
        "ask rotorid.autopilots instead: autopilot_of(record), or a field of the value"
    )
    assert {place for place, (count, _) in ALLOWED.items() if counts[place] < count} == set(), "the table can shrink"
