"""The command line. Every command calls one or two functions of the library."""

from __future__ import annotations

import io
import os
import sys
from typing import Annotated

import typer

from rotorid import __version__
from rotorid.cli.compare import compare_command
from rotorid.cli.console import listen, say
from rotorid.cli.delay import delay_command
from rotorid.cli.demo import demo_command
from rotorid.cli.design import design_command
from rotorid.cli.identify import identify_command
from rotorid.cli.inspect import inspect_command
from rotorid.cli.models import models_command
from rotorid.cli.options import with_options
from rotorid.cli.response import response_command
from rotorid.cli.simulate import simulate_command
from rotorid.cli.vehicles import vehicles_command
from rotorid.cli.verify import verify_command
from rotorid.errors import RotoridError

# The matrices of this package are small: threads inside one product cost more than they bring, tenfold under load.
# Read when NumPy is first imported, which the commands do later.
for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

_INTERRUPTED = 130

app = typer.Typer(
    name="rotorid",
    help="System identification for multirotors: flight log in, model with honest bounds and a report out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for _name, _command in (
    ("demo", demo_command),
    ("inspect", inspect_command),
    ("response", response_command),
    ("identify", identify_command),
    ("verify", verify_command),
    ("compare", compare_command),
    ("delay", delay_command),
    ("design", design_command),
    ("simulate", simulate_command),
    ("models", models_command),
    ("vehicles", vehicles_command),
):
    app.command(_name)(with_options(_command))


def _version(asked: bool) -> None:
    if asked:
        print(f"rotorid {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Entry point: errors become one sentence and an exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal that cannot show a sign shows a question mark; results are not lost over a unit.
        sys.stdout.reconfigure(errors="replace")
    listen()
    try:
        app()
    except RotoridError as error:
        say(f"rotorid: {error}")
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, SystemExit) as ended:
        # The command line's own handler turns an interrupt into this code before it comes here.
        if isinstance(ended, SystemExit) and ended.code != _INTERRUPTED:
            raise
        say("rotorid: interrupted; files that were complete stay, and no file is left half written")
        sys.exit(_INTERRUPTED)
    except BrokenPipeError:
        # Who reads has read enough; what Python would still flush at the end has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        say(f"rotorid: the output cannot be written: {error.strerror or error}")
        sys.exit(2)
