"""`rotorid run`: a project file without the page, told as commands that a shell takes as they are meant."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rotorid.cli.app import app
from rotorid.lab.steps import Project, Step, project_text


def test_what_it_says_can_be_pasted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "-a'; touch pwned; '.ulg"
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / name).write_bytes(b"no log")
    steps = (Step(verb="review", logs=(1,)), Step(verb="export", results=(1,)))
    text = project_text(Project(schema="rotorid.project/1", logs=(name,), steps=steps))
    (tmp_path / "logs" / "rotorid.toml").write_text(text, encoding="utf-8")
    carried_out: list[list[str]] = []

    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        carried_out.append(command[3:])
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "run", run)
    for folder, project in ((tmp_path, "logs/rotorid.toml"), (tmp_path / "logs", "rotorid.toml")):
        carried_out.clear()
        monkeypatch.chdir(folder)
        ran = CliRunner().invoke(app, ["run", project, "--out", "again"])
        assert ran.exit_code == 0, ran.output
        said = [line.split(": ", 1)[1] for line in ran.stderr.splitlines()]
        assert [shlex.split(line)[1:] for line in said] == carried_out
        log, export = carried_out[0][1], carried_out[1]
        # From where the shell stands it is the log, and no option.
        assert Path(log).samefile(tmp_path / "logs" / name)
        assert not log.startswith("-")
        assert export == ["export", "again/step-1", "--to", "json", "--out", "again/step-2"]
