"""The doctor: what is broken is said, and never by a traceback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid

from rotorid.cli import installation


def with_broken(folder: Path, module: str, content: str, *words: str) -> subprocess.CompletedProcess[str]:
    """``rotorid doctor`` where a library is broken."""
    (folder / f"{module}.py").write_text(content, encoding="utf-8")
    places = os.pathsep.join([str(folder), *(one for one in sys.path if one)])
    command = [sys.executable, "-m", "rotorid", "doctor", *words]
    environment = {**os.environ, "PYTHONPATH": places}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=300)


def test_a_sound_installation_is_sound() -> None:
    ran = rotorid("doctor", "--json")
    told = json.loads(ran.out)
    assert ran.code == 0
    assert told["schema"] == installation.SCHEMA
    assert told["sound"]
    assert {"version", "library", "extra", "machine", "cache", "settings", "sandbox", "self test"} == {
        check["group"] for check in told["checks"]
    }


@pytest.mark.parametrize("module", ["numpy", "scipy", "numba", "pydantic", "jinja2", "typer", "rich"])
def test_a_broken_library_is_named_with_its_remedy(module: str, tmp_path: Path) -> None:
    ran = with_broken(tmp_path, module, "raise OSError('libfortran.so.5: cannot open')", "--no-self-test")
    assert ran.returncode == 1
    assert "Traceback" not in ran.stderr + ran.stdout
    assert f"BROKEN   library    {module}" in ran.stdout
    assert f"pip install --force-reinstall {module}" in ran.stdout


def test_an_interpreter_that_crashes_ends_the_self_test_alone(tmp_path: Path) -> None:
    ran = with_broken(tmp_path, "scipy", "import os; os.abort()" if os.name == "nt" else "import os; os._exit(7)")
    assert ran.returncode in (1, 7)


def test_a_missing_extra_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "EXTRAS", {"lab": ("no_such_module",)})
    ran = rotorid("doctor", "--no-self-test")
    assert ran.code == 0
    assert "pip install 'rotorid[lab]'" in ran.out


def test_a_cache_that_cannot_be_written_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/nowhere/at/all")
    monkeypatch.setattr(os, "access", lambda *_: False)
    (check,) = installation._cache()
    assert check.state == "missing"
    assert "NUMBA_CACHE_DIR" in check.remedy


def test_a_self_test_that_is_wrong_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"L_roll": {"value": 1.0, "std": 0.1, "truth": 2.0, "unit": "rad/s^2", "off": -10.0}}
    answer = subprocess.CompletedProcess([], 0, stdout=json.dumps(found), stderr="")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: answer)
    (check,) = installation._self_test()
    assert check.state == "broken"
    assert "L_roll" in check.said


def test_a_self_test_that_fails_says_its_last_line(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = subprocess.CompletedProcess([], 1, stdout="", stderr="Traceback\nValueError: no")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: answer)
    (check,) = installation._self_test()
    assert check.state == "broken"
    assert "ValueError: no" in check.said


def test_whatever_is_raised_is_a_sentence() -> None:
    def _odd() -> list[installation.Check]:
        raise RuntimeError("a\nb")

    (check,) = installation._without_fail(_odd)
    assert check.state == "broken"
    assert check.said == "RuntimeError: a b"
