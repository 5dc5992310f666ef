"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

Logs: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        help="Flight logs: PX4, ArduPilot, Betaflight, Crazyflie, ROS, .mat, .csv and more; also compressed."
    ),
]
Log: TypeAlias = Annotated[
    Path, typer.Argument(help="A flight log: PX4, ArduPilot, Betaflight, Crazyflie, ROS, .mat, .csv and more.")
]
Map: TypeAlias = Annotated[
    Path | None, typer.Option("--map", help="TOML file that names the channels of any other source.")
]
Out: TypeAlias = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results. [default: rotorid-out/NAME]")
]
Json: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]
Quiet: TypeAlias = Annotated[bool, typer.Option("--quiet", help="Say nothing but errors.")]
Seed: TypeAlias = Annotated[int, typer.Option("--seed", help="Seed of everything drawn at random.")]
Band: TypeAlias = Annotated[str | None, typer.Option("--band", help="LO:HI in rad/s. [default: what was excited]")]
Windows: TypeAlias = Annotated[str | None, typer.Option("--windows", help="S,S,... window lengths in seconds.")]
Coherence: TypeAlias = Annotated[
    float | None, typer.Option("--coherence", help="Least coherence of a point. [default: 0.6 direct, 0.2 joint]")
]
Estimate: TypeAlias = Annotated[str, typer.Option("--estimate", help="auto, direct or joint.")]
Instrument: TypeAlias = Annotated[
    str | None, typer.Option("--instrument", help="CHANNEL,... to use as instruments, one for each input.")
]
Segments: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--segment", help="AXIS:START:STOP to use instead of what is found, in log seconds. Repeatable."),
]
Shifts: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--shift", help="CHANNEL:SECONDS to delay it by, where inspect finds its stamps wrong. Repeatable."),
]
Method: TypeAlias = Annotated[
    str,
    typer.Option(
        "--method",
        help="frequency, output_error, prediction_error, equation_error, or auto: output_error for response.* and "
        "black_box:N, frequency for others.",
    ),
]
Hold: TypeAlias = Annotated[
    str, typer.Option("--hold", help="zero or first order between samples, in time; auto: zero for logged commands.")
]
Starts: TypeAlias = Annotated[
    str, typer.Option("--starts", help="Where searches in time begin: default, central, sobol:N or random:N.")
]
Search: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--search",
        metavar="NAME[:OPTIONS]",
        help="A global search before the fit: evolution[:POPULATION] (when in doubt), cma[:POPULATION], "
        "genetic[:POPULATIONxGENERATIONS], kmeans[:CANDIDATES], sobol[:STARTS], random[:STARTS] or central. "
        "[default: none, the starts of the model]",
    ),
]
Evaluations: TypeAlias = Annotated[
    int | None, typer.Option("--evaluations", help="Costs that --search may compute. [default: 2000]")
]
Bootstrap: TypeAlias = Annotated[
    int | None,
    typer.Option("--bootstrap", help="Refits to noise drawn anew, for spreads and intervals: 200 and more."),
]
Pieces: TypeAlias = Annotated[
    float | None,
    typer.Option("--pieces", help="Seconds after which a fit in time begins anew. [default: as growing modes need]"),
]
Decoupled: TypeAlias = Annotated[
    bool, typer.Option("--decoupled", help="A black box for each input and its output, side by side.")
]
CrossValidate: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--cross-validate",
        help="each: identify on each log alone, score on all others. leave_one_out: on all but one, score on that one.",
    ),
]
