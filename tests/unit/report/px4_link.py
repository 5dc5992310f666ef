"""A PX4 at the other end of a link that is none, and plans that the script flies with it."""

from __future__ import annotations

import importlib.util
import io
import math
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from pymavlink.dialects.v20.common import MAVLink
from tests.unit.report.plan_sample import by_hand, chirp, facts, multisine, step

from rotorid.data.flight_plan import FlightPlan
from rotorid.plans.px4 import px4_files
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

POSITION, ALTITUDE, OFFBOARD, RETURN = 3, 2, 6, 4
HEADING = 0.4
RATE_HZ = 100.0


def attitude_plan() -> FlightPlan:
    inputs = (
        *multisine(("roll", "pitch", "yaw")),
        chirp("thrust", amplitude=0.05, band_hz=(0.2, 2.0), duration_s=20.0),
    )
    return FlightPlan(name="Attitude", inputs=inputs)


def heave_plan() -> FlightPlan:
    """Nothing but rest at level flight: thrust moves long after what a test looks at."""
    return FlightPlan(name="Heave", inputs=(step("thrust", start_s=45.0),))


def stick_plan() -> FlightPlan:
    return FlightPlan(name="Sticks", inputs=tuple(by_hand(axis) for axis in ("roll", "pitch", "yaw", "thrust")))


def loaded(plan: FlightPlan, folder: Path, **changes: Any) -> ModuleType:
    """The script as a module beside its table; nothing of it runs."""
    for name, text in px4_files(plan, facts("PX4", **changes)).items():
        (folder / name).write_text(text)
    specification = importlib.util.spec_from_file_location("px4_fly_plan", folder / "px4_fly_plan.py")
    assert specification
    assert specification.loader
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


class Time:
    """A clock that stands until somebody sleeps."""

    def __init__(self) -> None:
        self.at_s = 1000.0

    def now(self) -> float:
        return self.at_s

    def sleep(self, seconds: float) -> None:
        # A computer sleeps a little longer than it was asked to.
        self.at_s += seconds + 1e-7


class Link:
    """A PX4 that hovers. A pilot switches to Offboard after two seconds; ``change`` happens at its time."""

    target_system, target_component = 1, 1

    def __init__(self, clock: Time, change: tuple[float, dict[str, Any]] | None = None, *, pilot: bool = True) -> None:
        self.clock, self.change, self.pilot = clock, change, pilot
        self.began_s = clock.now()
        self.says: dict[str, Any] = {"mode": POSITION, "armed": True, "attitude": (0.0, 0.0, HEADING)}
        self.says |= {"rates": (0.0, 0.0, 0.0), "position": (1.0, 2.0, -20.0), "velocity": (0.0, 0.0, 0.0)}
        self.says |= {"battery": 80, "silent": False}
        self.waiting: deque[Any] = deque()
        self.sent: list[tuple[float, str, tuple[Any, ...]]] = []
        self.last_s = -math.inf
        self.mav = self
        self.packer = MAVLink(io.BytesIO())

    def __getattr__(self, name: str) -> Any:
        if not name.endswith("_send"):
            raise AttributeError(name)

        def note(*values: Any) -> None:
            # A message that MAVLink cannot pack was never sent.
            getattr(self.packer, name)(*values)
            self.sent.append((self.clock.now(), name, values))
            if name == "command_long_send" and values[2] == 176:
                self.says["mode"] = values[5]

        return note

    def recv_match(self, *, blocking: bool) -> Any:
        assert not blocking
        since = self.clock.now() - self.began_s
        if self.change and since >= self.change[0]:
            self.says |= self.change[1]
            self.change = None
        if self.pilot and since >= 2.0:
            self.says["mode"], self.pilot = OFFBOARD, False
        if self.clock.now() - self.last_s >= 0.02:
            self.last_s = self.clock.now()
            self.waiting.extend(self.messages())
        return self.waiting.popleft() if self.waiting else None

    def messages(self) -> list[SimpleNamespace]:
        says = self.says
        roll, pitch, yaw = says["attitude"]
        p, q, r = says["rates"]
        x, y, z = says["position"]
        vx, vy, vz = says["velocity"]
        beat = {"custom_mode": says["mode"] << 16, "base_mode": 1 | 128 * says["armed"], "get_srcComponent": lambda: 1}
        found: list[tuple[str, dict[str, Any]]] = [("HEARTBEAT", beat)]
        # Somebody else on the link, in another mode: not the autopilot.
        found.append(("HEARTBEAT", beat | {"custom_mode": RETURN << 16, "get_srcComponent": lambda: 190}))
        if not says["silent"]:
            found.append(
                ("ATTITUDE", {"roll": roll, "pitch": pitch, "yaw": yaw, "rollspeed": p, "pitchspeed": q, "yawspeed": r})
            )
            found.append(("LOCAL_POSITION_NED", {"x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz}))
            found.append(("SYS_STATUS", {"battery_remaining": says["battery"]}))
        return [SimpleNamespace(get_type=lambda kind=kind: kind, **values) for kind, values in found]

    def of(self, name: str) -> tuple[FloatArray, list[tuple[Any, ...]]]:
        chosen = [(time_s - self.began_s, values) for time_s, kind, values in self.sent if kind == name]
        return np.array([time_s for time_s, _ in chosen]), [values for _, values in chosen]


def flown(
    plan: FlightPlan,
    folder: Path,
    change: tuple[float, dict[str, Any]] | None = None,
    *,
    pilot: bool = True,
    words: Sequence[str] = ("--hover-thrust", "0.5"),
) -> tuple[str, Link, ModuleType]:
    module = loaded(plan, folder)
    clock = Time()
    link = Link(clock, change, pilot=pilot)
    limits = module.arguments(list(words))
    reason = module.Flight(link, module.Plan(limits.plan), limits, clock, say=lambda text: None).run()
    return reason, link, module


def euler(q: Sequence[float]) -> tuple[float, float, float]:
    w, x, y, z = q
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(2.0 * (w * y - z * x)),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


class Drifting(Link):
    """A PX4 that goes where its lean and the wind push it: a point that follows its attitude set-points with a lag."""

    def __init__(
        self,
        clock: Time,
        *,
        heading: float = HEADING,
        wind: tuple[float, float] = (0.0, 0.0),
        gusts_m_s: float = 0.0,
        velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
        trimmed: bool = True,
        hover: float = 0.5,
        lag_s: float = 0.2,
        drag_1_s: float = 0.3,
    ) -> None:
        super().__init__(clock)
        # In Position mode it leans against the wind so that it stays.
        ahead, right = turned((-drag_1_s * wind[0], -drag_1_s * wind[1]), -heading)
        lean = (math.atan(right / STANDARD_GRAVITY_M_S2), -math.atan(ahead / STANDARD_GRAVITY_M_S2), heading)
        self.says |= {"attitude": lean if trimmed else (0.0, 0.0, heading)}
        self.lag_s, self.drag_1_s = lag_s, drag_1_s
        self.pushed, self.gusts_m_s, self.velocity, self.hover = wind, gusts_m_s, velocity, hover
        self.gust = np.zeros(2)
        self.random = np.random.default_rng(4)
        self.trace: list[tuple[float, ...]] = []
        self.moved_s = clock.now()

    def recv_match(self, *, blocking: bool) -> Any:
        if self.says["mode"] == OFFBOARD and self.sent:
            self.move(self.clock.now() - self.moved_s)
        self.moved_s = self.clock.now()
        return super().recv_match(blocking=blocking)

    def move(self, step_s: float) -> None:
        if not step_s:
            return
        if not self.trace:
            self.says["velocity"] = self.velocity
        asked = [one for _, name, one in self.sent[-3:] if name == "set_attitude_target_send"][-1]
        share = 1.0 - math.exp(-step_s / self.lag_s)
        attitude = [old + share * (new - old) for old, new in zip(self.says["attitude"], euler(asked[4]), strict=True)]
        # Turbulence that keeps its size and forgets itself within two seconds.
        self.gust += -self.gust * step_s / 2.0 + self.gusts_m_s * math.sqrt(step_s) * self.random.standard_normal(2)
        push = turned(
            (-STANDARD_GRAVITY_M_S2 * math.tan(attitude[1]), STANDARD_GRAVITY_M_S2 * math.tan(attitude[0])), attitude[2]
        )
        air = [wind + gust for wind, gust in zip(self.pushed, self.gust, strict=True)]
        down = STANDARD_GRAVITY_M_S2 * (1.0 - asked[8] / self.hover)
        speed = list(self.says["velocity"])
        for axis in range(2):
            speed[axis] += step_s * (push[axis] - self.drag_1_s * (speed[axis] - air[axis]))
        speed[2] += step_s * (down - self.drag_1_s * speed[2])
        place = [old + step_s * v for old, v in zip(self.says["position"], speed, strict=True)]
        self.says |= {"attitude": tuple(attitude), "position": tuple(place), "velocity": tuple(speed)}
        self.trace.append((self.clock.now() - self.began_s, place[0] - 1.0, place[1] - 2.0, place[2] + 20.0))


def turned(vector: tuple[float, float], angle: float) -> tuple[float, float]:
    """From the frame of a heading to north and east."""
    x, y = vector
    return math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y
