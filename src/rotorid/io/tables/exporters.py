"""Tables that well-known programs write, known by their headers: what each is, and the one thing to type."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

_PAGE = "docs/mappings"


@dataclass(frozen=True, kw_only=True, slots=True)
class Exporter:
    """A program that writes tables.

    Parameters
    ----------
    words
        Whose table it is.
    remedy
        What to type or give.
    begins
        How its header begins, in small letters, cells joined by commas; empty for any.
    holds
        Parts of its header, of which one is there; empty where the beginning is enough.
    """

    words: str
    remedy: str
    begins: tuple[str, ...] = ("",)
    holds: tuple[str, ...] = ("",)


EXPORTERS: Sequence[Exporter] = (
    Exporter(
        words="PlotJuggler's export",
        begins=("__time,",),
        remedy="give the log that PlotJuggler opened, or name the columns: --map FILE.toml",
    ),
    Exporter(
        words="the output of rostopic echo -p",
        begins=("time,field.", "%time,field."),
        remedy=f"add --map FILE.toml as {_PAGE}/rostopic_imu.toml, or give the bag itself",
    ),
    Exporter(
        words="QGroundControl's telemetry",
        begins=("timestamp,",),
        holds=(",rollrate", ",groundspeed", ",flightdistance"),
        remedy=f"add --map FILE.toml as {_PAGE}/qgroundcontrol.toml; the log of the autopilot shows more",
    ),
    Exporter(
        words="the Crazyflie client's",
        begins=("timestamp,",),
        holds=("gyro.x", "acc.z", "stabilizer.roll", "stateestimate.", "motor.m1", "pm.vbat"),
        remedy=f"add --map FILE.toml as {_PAGE}/crazyflie_client.toml",
    ),
    Exporter(
        words="NanoBench's",
        begins=("t,px,py,pz,",),
        holds=(",imu_gyro_x,", ",motor_motor_m1,"),
        remedy=f"add --map FILE.toml as {_PAGE}/nanobench.toml, which names units and axes",
    ),
    Exporter(
        words="IDSIA's nanodrone benchmark",
        begins=("t,x,y,z,",),
        holds=(",m1_erpm,", ",m1_thrust,", ",ros_timestamp"),
        remedy=f"add --map FILE.toml as {_PAGE}/idsia_nanodrone.toml, which names units and axes",
    ),
    Exporter(
        words="NeuroBEM's",
        begins=("bemnn",),
        remedy=f"add --map FILE.toml as {_PAGE}/neurobem.toml, which names columns, units and axes",
    ),
    Exporter(words="Mission Planner's export of a .tlog", holds=(",mavlink_",), remedy="give the .tlog itself"),
    Exporter(
        words="Vicon's",
        begins=("frame,sub frame", "frame,subframe"),
        remedy="name the columns, and the rate as sample_rate_hz in [clock]: --map FILE.toml",
    ),
    Exporter(
        words="OptiTrack's",
        begins=("format version,", "frame,time"),
        remedy="delete the lines above the names of the columns, and name them: --map FILE.toml",
    ),
    Exporter(
        words="DJI's, as AirData and others convert it",
        begins=("custom.", "time(millisecond),", "osd.", "clock:"),
        remedy="name the columns: --map FILE.toml; it has 10 Hz and no motor commands, for an overview only",
    ),
)


def foreign_remedy(header: Sequence[str]) -> str:
    """What to do with a table whose header is that of a known program; empty for all others.

    Examples
    --------
    >>> foreign_remedy(["a", "b"]), "PlotJuggler" in foreign_remedy(["__time", "/imu/gyro/x"])
    ('', True)
    """
    joined = ",".join(cell.strip() for cell in header).lower()
    for known in EXPORTERS:
        if joined.startswith(known.begins) and any(part in joined for part in known.holds):
            return f"it looks like {known.words}: {known.remedy}"
    return ""
