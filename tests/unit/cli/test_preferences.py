"""A file of preferences changes how results look and where they go, and no number."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rotorid.cli.app import as_preferred
from rotorid.cli.preferences import Preferences, place, preferences, read_preferences
from rotorid.errors import UsageError
from rotorid.report.frame import Appearance, appearance


def _file(folder: Path, text: str) -> Path:
    file = folder / "rotorid.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_what_it_says_is_read(tmp_path: Path) -> None:
    text = 'frequency = "Hz"\nangles = "deg"\nmagnitude = "linear"\ntheme = "dark"\nout = "~/flights"\n'
    expected = Preferences(frequency="Hz", angles="deg", magnitude="linear", theme="dark", out=Path.home() / "flights")
    assert read_preferences(_file(tmp_path, text)) == expected
    assert read_preferences(_file(tmp_path, "")) == Preferences()


@pytest.mark.parametrize(
    ("text", "said"),
    [('colour = "red"', r"'colour' in line 1, .* unknown; expected one of frequency, angles, magnitude, theme, out"),
     ('theme = "pink"', r"sets theme = 'pink' in line 1; expected 'light' or 'dark'"), ("out = 3", "expected a folder"),
     ('theme = "dark"\nangles = "grad"', r"sets angles = 'grad' in line 2; expected 'rad' or 'deg'"),
     ('# mine\n"color" = 1\ntheme = "dark"\n[lab]\nport = 1', r"sets 'color' in line 2 and 'lab' in line 4, which are"),
     ("lab.port = 1", "'lab' in line 1"), ("frequency = [", "cannot be read"), ("theme = {}", "'light' or 'dark'"),
     ("\0", "cannot be read"),
     ('out = "~nosuch/x"', "out = '~nosuch/x' in line 1; expected an existing home folder"),
     ('out = "a\\u0000b"', "in line 1; expected a folder"), ('out = ""', "expected a folder"),
     ("x = " + "[" * 3000, "64 deep")],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(text: str, said: str, tmp_path: Path) -> None:
    file = _file(tmp_path, text)
    with pytest.raises(UsageError, match=said) as caught:
        read_preferences(file)
    assert str(file) in str(caught.value)


def test_a_file_that_was_named_is_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("nowhere.toml", "a" * 300, "a\0b"):
        # The environment cannot hold the last name, a caller can.
        monkeypatch.setattr("rotorid.cli.preferences.place", lambda name=name: tmp_path / name)
        monkeypatch.setenv("ROTORID_SETTINGS", "named")
        preferences.cache_clear()
        with pytest.raises(UsageError, match="cannot be read"):
            preferences()
    monkeypatch.delenv("ROTORID_SETTINGS")
    monkeypatch.setattr("rotorid.cli.preferences.place", lambda: tmp_path / "nowhere.toml")
    assert preferences() == Preferences()
    monkeypatch.setattr("rotorid.cli.preferences.place", lambda: tmp_path / ("a" * 300))
    preferences.cache_clear()
    with pytest.raises(UsageError, match="cannot be read"):
        preferences()
    preferences.cache_clear()


def test_what_a_person_prefers_ends_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotorid.cli.preferences.preferences", lambda: Preferences(theme="dark"))
    seen = []
    as_preferred(lambda: seen.append(appearance.get().theme))()
    assert seen == ["dark"]
    assert appearance.get() == Appearance()


def test_where_it_lies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROTORID_SETTINGS", "")
    assert place() is None
    monkeypatch.setenv("ROTORID_SETTINGS", str(tmp_path / "mine.toml"))
    assert place() == tmp_path / "mine.toml"
    monkeypatch.delenv("ROTORID_SETTINGS")
    monkeypatch.setattr("rotorid.cli.preferences.sys.platform", "linux")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert place() == tmp_path / "rotorid.toml"


@pytest.mark.slow
def test_commands_follow_it_and_numbers_do_not(tmp_path: Path) -> None:
    out = tmp_path / "there"
    wanted = _file(tmp_path, f'frequency = "Hz"\ntheme = "dark"\nout = {json.dumps(str(out))}\n')

    def run(settings: str, *words: str) -> subprocess.CompletedProcess[str]:
        import os

        environment = {**os.environ, "ROTORID_SETTINGS": settings}
        command = [sys.executable, "-m", "rotorid", *words]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)

    run("", "example", "rig", "--out", "rig", "--quiet")
    log = next(one for one in (tmp_path / "rig").iterdir() if one.name.startswith("flight"))
    told = run(str(wanted), "review", str(log), "--json")
    plain = run("", "review", str(log), "--json")
    assert told.stdout == plain.stdout
    (page,) = out.glob("*/review.html")
    assert '<html lang="en" data-frequency="Hz" data-theme="dark">' in page.read_text(encoding="utf-8")
    assert list((tmp_path / "rotorid-out").glob("*/review.html"))
    wrong = run(str(_file(tmp_path, "speed = 1")), "models")
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("rotorid: ")
    assert "'speed'" in wrong.stderr
    doctor = run(str(tmp_path / "rotorid.toml"), "doctor", "--no-self-test")
    assert "Traceback" not in doctor.stderr
    assert "'speed'" in doctor.stdout
    assert doctor.returncode == 1
