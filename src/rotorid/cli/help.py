"""Help of commands: examples that run, the options that are used most, and all options with ``--help-all``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperOption


class CommandHelp(NamedTuple):
    """What the help of a command begins with.

    Parameters
    ----------
    examples
        Arguments of three calls, as they are typed.
    options
        The options that are used most, at most ten; a command with few options shows all.
    missing
        What to type for an option that a call lacks, by option.
    """

    examples: tuple[str, str, str]
    options: str = ""
    missing: Mapping[str, str] = MappingProxyType({})


_LOG = "example-px4/flight.ulg"

HELP: Mapping[str, CommandHelp] = MappingProxyType(
    {
        "demo": CommandHelp(("", "--keep-log --out demo", "--seed 2 --json")),
        "review": CommandHelp(
            (_LOG, f"{_LOG} --open", f"{_LOG} example-ardupilot/flight.BIN --out both"),
            "--open --no-models --map --plan --figures --pdf --out --json --quiet --verbose",
        ),
        "inspect": CommandHelp((_LOG, f"{_LOG} --out inspected", "example-px4 --json")),
        "response": CommandHelp(
            (_LOG, f"{_LOG} --inputs roll_command --outputs p", f"{_LOG} --band 0.5:15Hz --figures pdf"),
            "--inputs --outputs --band --windows --segment --instrument --coherence --figures --out --verbose",
        ),
        "identify": CommandHelp(
            (
                f"{_LOG} --model all",
                f"{_LOG} --model rate.roll,rate.pitch,rate.yaw --out example-px4/model",
                f"{_LOG} --model hover.lateral --reduce --band 0.3:8Hz",
            ),
            "--model --verify --band --segment --fix --reduce --search --map --out --verbose",
            MappingProxyType({"--model": "--model all"}),
        ),
        "verify": CommandHelp(
            (
                f"example-px4/model/rate.roll {_LOG}",
                f"example-px4/model/rate.roll {_LOG} --figures svg",
                f"example-px4/model/rate.roll {_LOG} --band 1:8Hz --json",
            ),
            "--segment --band --windows --low-pass --controller --scale --map --figures --out --verbose",
        ),
        "compare": CommandHelp(
            (
                "example-px4/model/rate.roll example-px4/model/rate.pitch",
                f"example-px4/model/rate.roll other/rate.roll --log {_LOG}",
                "example-px4/model/rate.roll other/rate.roll --tables csv",
            ),
            "--log --segment --shift --hold --map --figures --tables --out --json --verbose",
        ),
        "bench": CommandHelp(
            (
                "neurobem --data neurobem",
                "idsia --data nanodrone --predictions mine.csv --tables tex",
                "nanobench --data dataset --predictions mymodel:predict",
            ),
            "--data --predictions --label --tables --pdf --out --json --verbose",
        ),
        "delay": CommandHelp(
            (_LOG, f"{_LOG} --input roll_command --output p", f"{_LOG} --json"),
            "--input --output --segment --band --shift --windows --map --out --json --verbose",
        ),
        "design": CommandHelp(
            (
                "sweep --vehicle x500",
                "sweep multisine --vehicle iris --axis roll,pitch --duration 60",
                f"sweep --vehicle px4_quad --gains {_LOG} --for px4",
            ),
            "--vehicle --axis --band --duration --model --gains --for-tune --for --out --verbose",
            MappingProxyType({"--vehicle": "--vehicle px4_quad"}),
        ),
        "simulate": CommandHelp(
            ("x500", "px4_quad --plan everyday --duration 60", f"example-px4/model/rate.roll --log {_LOG}"),
            "--plan --duration --log --set --wind --turbulence --format --seed --out --verbose",
        ),
        "stitch": CommandHelp(
            (
                "hover/hover.longitudinal forward/hover.longitudinal",
                f"hover/hover.longitudinal forward/hover.longitudinal --log {_LOG}",
                "hover/hover.longitudinal forward/hover.longitudinal --out stitched",
            )
        ),
        "tune": CommandHelp(
            (_LOG, "example-px4/model --out example-px4/gains", "new-flight.ulg --check example-px4/gains"),
            "--axes --robustness --noise --keep --only --set --check --map --out --verbose",
        ),
        "export": CommandHelp(
            (
                "example-px4/model --to json",
                "example-px4/model --to matlab --out matlab",
                "example-px4/model --to px4-sih --set m=1 --set arm=0.283 --set I_zz=0.03 --set kappa=0.02",
            ),
            "--to --set --layout --name --delay-as-lag --no-delay --sample-rate --draws --out --verbose",
            MappingProxyType({"--to": "--to json"}),
        ),
        "fleet": CommandHelp(
            ("example-px4", "example-px4 example-ardupilot --out fleet", "'logs/*.ulg' --workers 4"),
            "--models --review --vehicles --workers --timeout --resume --pdf --out --json --verbose",
        ),
        "track": CommandHelp(
            (_LOG, f"{_LOG} --model rate.pitch", f"{_LOG} --model example-px4/model/rate.roll"),
            "--model --step --first --map --pdf --out --json --verbose",
        ),
        "lab": CommandHelp((_LOG, "example-px4", f"{_LOG} --port 8000 --no-open")),
        "mcp": CommandHelp(("example-px4", "example-px4 logs", "logs --out logs/results")),
        "run": CommandHelp(("project.toml", "project.toml --out steps", "project.toml --quiet")),
        "models": CommandHelp(("", "rate.roll", "transfer:0/2 --inputs roll_command --outputs p")),
        "vehicles": CommandHelp(("", "x500 --toml", "--json")),
        "example": CommandHelp(("", "px4", "ardupilot --out flight --seed 2")),
        "doctor": CommandHelp(("", "--no-self-test", "--json")),
    }
)
"""By command."""

_MANY = 12
"""Options beyond which a command lists them under headings, and its short help only the most used."""
_LAST = ("Results", "Options")


class HelpfulCommand(TyperCommand):
    """A command whose help begins with examples and the most used options; ``--help-all`` lists all."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The options, with ``--help-all`` before ``--help``."""
        params: list[Any] = list(super().get_params(ctx))
        helped = params.pop()
        if getattr(self, "_help_all", None) is None:
            self._help_all = TyperOption(
                param_decls=["--help-all"],
                type_descriptor=helped.type_descriptor,
                is_flag=True,
                is_eager=True,
                expose_value=False,
                callback=_show_all,
                show_default=False,
                help=f"Show all {sum(param.param_type_name == 'option' for param in params)} options.",
            )
        return [*params, self._help_all, helped]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Arguments, then options."""
        arguments = [param for param in self.get_params(ctx) if param.param_type_name == "argument"]
        names = [argument_name(param) for param in arguments]
        return [
            *(name if param.required else f"[{name}]" for name, param in zip(names, arguments, strict=True)),
            "[OPTIONS]",
        ]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Examples, arguments, then options by what they are about."""
        helped = HELP[self.name or ""]
        with formatter.section("Examples"):
            for words in helped.examples:
                formatter.write(f"{'':{formatter.current_indent}}rotorid {f'{self.name} {words}'.strip()}\n")
        params = [param for param in self.get_params(ctx) if param.get_help_record(ctx) is not None]
        options = [param for param in params if param.param_type_name == "option"]
        short = not ctx.meta.get(_ALL) and len(options) > _MANY
        if short:
            options = [
                option
                for name in helped.options.split()
                for option in options
                if name in (*option.opts, *option.secondary_opts)
            ]
            options += [param for param in params if {"--help-all", "--help"} & {*param.opts}]
        elif len(options) <= _MANY:
            options = [option for option in options if "--help-all" not in option.opts]  # all are here already
        sections: dict[str, list[Any]] = {"Arguments": [p for p in params if p.param_type_name == "argument"]}
        for option in options:
            heading = getattr(option, "rich_help_panel", None) if len(options) > _MANY else None
            heading = "Most used options" if short else heading or "Options"
            sections.setdefault(heading, []).append(option)
        for title in (*(title for title in sections if title not in _LAST), *_LAST):
            if sections.get(title):
                with formatter.section(title):
                    formatter.write_dl([_help_record(param, ctx) for param in sections[title]])


_ALL = "rotorid.help_all"


def _show_all(ctx: Any, _param: Any, asked: bool) -> None:
    if asked:
        ctx.meta[_ALL] = True
        typer.echo(ctx.get_help())
        ctx.exit()


def argument_name(param: Any) -> str:
    """What help calls an argument: ``LOG...``."""
    name = re.sub(r"[\[\]]", "", param.metavar or param.name.upper())
    return name if name.endswith("...") or param.nargs == 1 else f"{name}..."


def _help_record(param: Any, ctx: Any) -> tuple[str, str]:
    """Name and help of a parameter; several of a kind are written as one."""
    name, text = param.get_help_record(ctx)
    if param.param_type_name == "argument":
        return argument_name(param), text.removesuffix("[required]").rstrip()
    return re.sub(r"<list\[(\w+)\]>", lambda kind: f"<{kind[1].lower()}>", name), text
