"""Bad models and bad choices about them: the name or line that is wrong, the right exit code, nothing left behind."""

from __future__ import annotations

import ctypes
from pathlib import Path

import pytest
from tests.hostile.test_bad_input import assert_one_sentence
from tests.unit.cli.commands import fly_roll_sweeps, rotorid

from rotorid.documents.result import ResultDocument


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(log)
    return log


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, so that anything left behind shows."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize(
    ("choice", "says"),
    [
        (("--fix", "L_pp=-2"), "did you mean L_p?"),
        (("--tie", "L_pp=L_roll"), "did you mean L_p?"),
        (("--tie", "L_p=-L_rol"), "did you mean L_roll?"),
        (("--tie", "L_p=L_p"), "loop: L_p -> L_p"),
        (("--tie", "L_p=2*("), "'2*(' cannot be read"),
        (("--free", "tau_rol"), "did you mean tau_roll?"),
        (("--model", "hover.lateral", "--constant", "theta=0.1"), "did you mean theta0?"),
        (("--model", "hover.lateral", "--constant", "theta0=nan"), "finite"),
        (("--outputs", "pp"), "did you mean p?"),
        (("--outputs", "q"), "one of p, v, phi, ay"),
        (("--outputs", ","), "no output"),
        (("--outputs", "p,p"), "each once"),
        (("--inputs", "rol_command"), "the inputs rol_command came with axis.roll"),
        (("--pair", "p/rol_command"), "did you mean p/roll_command?"),
        (("--pair", "nonsense"), "one of p/roll_command"),
        (("--weight", "p/roll_comand=2"), "did you mean p/roll_command?"),
        (("--weights", "cifr"), "did you mean cifer?"),
        (("--speed-damping", "two"), "did you mean two_step?"),
        (("--model", "axis.rol"), "did you mean axis.roll?"),
    ],
)
def test_unknown_names_get_the_nearest_before_any_log_is_read(choice: tuple[str, ...], says: str, here: Path) -> None:
    # The log does not even exist: what is wrong with the words is said first.
    model = () if "--model" in choice else ("--model", "axis.roll")
    sentence = assert_one_sentence(rotorid("identify", "no.csv", *model, *choice), 2)
    assert says in sentence
    assert list(here.iterdir()) == []


HEAD = 'name = "mine"\ninputs = ["roll_command"]\n'
EQUATION = HEAD + 'states = ["p"]\nequations = ["p\' = a*p + b*roll_command"]\noutputs = ["p"]\n'
NUMBERS = '[parameters.a]\nvalue = -1.0\nunit = "1/s"\n[parameters.b]\nvalue = 100.0\nunit = "rad/s^2"\n'
C = '[parameters.c]\nvalue = {}\nunit = "1"\n'
MATRICES = HEAD + 'states = ["p", "z"]\noutputs = ["p"]\nF = [["a", 1], [1, 0]]\nG = [["b"], [0]]\nH0 = [[1, 0]]\n'
BAD = {
    "loop of ties": (
        EQUATION + '[parameters.a]\ntied = "b"\nunit = "1/s"\n[parameters.b]\ntied = "a"\nunit = "1/s"\n',
        ("line 7", "loop: a -> b -> a"),
    ),
    "wrong shape": (
        MATRICES.replace('[["b"], [0]]', '[["b"]]') + NUMBERS,
        ("line 6", "G"),
    ),
    "wrong unit": (EQUATION + NUMBERS.replace("1/s", "furlong"), ("line 8", "'furlong'", "SI unit")),
    "unknown symbol": (EQUATION.replace("b*", "bb*") + NUMBERS, ("line 4", "bb", "did you mean b?")),
    "state without equation": (EQUATION.replace('["p"]\neq', '["p", "phi"]\neq') + NUMBERS, ("line 4", "phi'")),
    "no TOML": ("name = [", ("line 1", "TOML")),
    "deep brackets": (EQUATION.replace("a*p", "(" * 3000 + "a" + ")" * 3000 + "*p") + NUMBERS, ("line 4", "levels")),
    "long expression": (EQUATION.replace("a*p", f"({'+'.join(['a'] * 20000)})*p") + NUMBERS, ("line 4", "characters")),
    "huge exponent": (EQUATION.replace("b*", "b**1e308*") + NUMBERS, ("start values", "no finite value")),
    "division by zero": (EQUATION.replace("b*", "b/c*") + NUMBERS + C.format(0), ("start values", "c = 0")),
    "logarithm of a negative number": (
        EQUATION.replace("b*", "log(c)*b*") + NUMBERS + C.format(-1),
        ("start values", "c = -1"),
    ),
    "nothing free": (EQUATION + NUMBERS.replace('"\n', '"\nstatus = "fixed"\n'), ("every parameter is fixed",)),
}


@pytest.mark.parametrize(("text", "says"), BAD.values(), ids=BAD.keys())
def test_a_wrong_file_says_where_and_what_before_any_log_is_read(
    text: str, says: tuple[str, ...], here: Path, tmp_path: Path
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text, encoding="utf-8")
    sentence = assert_one_sentence(rotorid("identify", "no.csv", "--model", file), 2)
    for part in says:
        assert part in sentence
    assert len(sentence) < 1000
    assert list(here.iterdir()) == []


ABSURD = {
    "singular M": MATRICES.replace("F =", "M = [[1, 1], [1, 1]]\nF =").replace("[1, 0]]\nG", '["a", 1]]\nG')
    .replace("[0]]\nH0", '["b"]]\nH0') + NUMBERS,
    "M of zero at the start": EQUATION.replace("p' =", "c*p' =") + NUMBERS + C.format(0),
    "values near the largest number": EQUATION + NUMBERS.replace("100.0", "1e308"),
    "a delay of ages": EQUATION + '[delays]\nroll_command = "t"\n' + NUMBERS
    + '[parameters.t]\nvalue = 1e300\nunit = "s"\n',
    "a function that overflows": EQUATION.replace("b*", "exp(c)*b*") + NUMBERS + C.format(700),
    "more parameters than points": HEAD
    + f"states = {[f'x{i}' for i in range(200)]}\n"
    + f"equations = {[f'x{i}_ = a{i}*x{i} + b{i}*roll_command'.replace('_', chr(39)) for i in range(200)]}\n"
    + f"outputs = ['p = {' + '.join(f'x{i}' for i in range(200))}']\n"
    + "".join(f"[parameters.{n}{i}]\nvalue = {-1 - i}\nunit = '1/s'\n" for i in range(200) for n in "ab"),
}  # fmt: skip


@pytest.mark.parametrize("text", ABSURD.values(), ids=ABSURD.keys())
def test_an_absurd_model_ends_in_an_answer_and_the_numerics_stay_silent(
    text: str, flight: Path, here: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """What LAPACK says about numbers that are none comes past Python's streams, and is looked for behind them."""
    file = tmp_path / "mine.toml"
    file.write_text(text, encoding="utf-8")
    ran = rotorid("identify", flight, "--model", file, "--out", tmp_path / "out")
    assert ran.code in (0, 1, 2)
    assert "Traceback" not in ran.err + ran.out
    assert below_python(capfd) == ""
    assert ran.err.startswith("rotorid: ") or ran.code == 0
    # Whole or not at all.
    assert (tmp_path / "out" / "result.json").exists() == (ran.code == 0)
    assert list(here.iterdir()) == []


def test_what_a_library_says_below_python_is_seen(capfd: pytest.CaptureFixture[str]) -> None:
    ctypes.CDLL(None).puts(b"On entry to DLASCL parameter number 4 had an illegal value")
    assert "illegal value" in below_python(capfd)


def below_python(capfd: pytest.CaptureFixture[str]) -> str:
    """What reached the descriptors of this process, that which C still keeps included."""
    ctypes.CDLL(None).fflush(None)
    return "".join(capfd.readouterr())


def test_parameters_that_only_stand_in_a_product_are_named(flight: Path, here: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = EQUATION.replace("b*", "b*c*") + NUMBERS.replace("100.0", "20.0") + C.format(5.0)
    file.write_text(text, encoding="utf-8")
    ran = rotorid("identify", flight, "--model", file, "--band", "12:25", "--out", tmp_path / "out", "--json")
    assert (ran.code, ran.err) == (0, "")
    document = ResultDocument.model_validate_json(ran.out)
    combination, *_ = document.identifiability
    assert "b*c" in combination.words.replace(" ", "")
    assert "--fix b=VALUE" in combination.words
    assert {name for name, share in combination.vector.items() if abs(share) > 0.1} == {"b", "c"}
    # A person reads the same sentence.
    said = rotorid("identify", flight, "--model", file, "--band", "12:25", "--out", tmp_path / "out")
    assert combination.words in said.out


def test_parameters_that_no_fitted_response_shows_are_named(flight: Path, here: Path) -> None:
    ran = rotorid("identify", flight, "--model", "hover.lateral", "--fix", "N_yaw=10")
    assert "depends on N_yaw, given with --fix" in assert_one_sentence(ran, 2)
    # No response of hover.full leads from roll to the pitch rate; and the controller moved yaw, which is said first.
    ran = rotorid("identify", flight, "--model", "hover.full", "--outputs", "q", "--json")
    assert ran.code == 1
    document = ResultDocument.model_validate_json(ran.out)
    assert {one.kind for one in document.findings if one.severity == "error"} == {"correlated_inputs"}
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    "channels",
    [("--inputs", "roll_comand", "--outputs", "p"), ("--inputs", "roll_command", "--outputs", "p_setpoint")],
)
def test_outputs_and_inputs_that_the_log_lacks_are_named(channels: tuple[str, ...], flight: Path, here: Path) -> None:
    ran = rotorid("identify", flight, "--model", "transfer:0/1", *channels)
    sentence = assert_one_sentence(ran, 1)
    assert f"has no {channels[1] if channels[1] != 'roll_command' else channels[3]}" in sentence
    assert "roll_command, pitch_command" in sentence
    assert list(here.iterdir()) == []


def test_a_model_of_which_the_log_holds_no_output_is_refused(flight: Path, here: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(EQUATION.replace('outputs = ["p"]', 'outputs = ["spin = p"]') + NUMBERS, encoding="utf-8")
    sentence = assert_one_sentence(rotorid("identify", flight, "--model", file), 1)
    assert "has no spin" in sentence
    assert list(here.iterdir()) == []
