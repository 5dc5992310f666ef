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
