"""The identified vehicle as a linear model around hover, from motor outputs to rates and specific force."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.models.description import from_toml
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.motor_fitting import MotorIdentified, levers_of

_ROWS = {"p": ("p", "roll"), "q": ("q", "pitch"), "r": ("r", "yaw")}
_DAMPING = {"p": "L_p", "q": "M_q", "r": "N_r"}
_INERTIA = {"p": "1/I_xx", "q": "1/I_yy", "r": "kappa_per_I_zz"}


def hover_model(identified: MotorIdentified) -> LinearStructure:
    r"""Small motions about hover, with the identified values.

    .. math:: \delta F_i = (c_1 + 2 c_2 x_0) \, \delta x_i

    at the mean output :math:`x_0` of the flights. The delay to the gyros stands for that to the accelerometer too.
    """
    parameters = identified.parameters
    axes = [axis for axis in ("p", "q", "r") if axis in identified.axes]
    motors = range(1, identified.data.layout.rotors + 1)
    lag = "T_motor" in parameters.names
    thrusts = {i: f"x_{i}" if lag else f"motor_{i}" for i in motors}
    equations = [f"T_motor*x_{i}' = -x_{i} + motor_{i}" for i in motors] if lag else []
    for axis, levers in zip(("p", "q", "r"), levers_of(identified.data), strict=True):
        if axis in axes:
            moment = _sum({thrusts[i]: lever for i, lever in zip(motors, levers.tolist(), strict=True)})
            equations.append(f"{axis}' = {_DAMPING[axis]}*{axis} + {axis}_thrust*({moment})")
    force = f"az_thrust*({_sum(dict.fromkeys(thrusts.values(), -1.0))})"
    heave = "Z_w" in parameters.names
    equations.append(f"w' = {'Z_w*w + ' if heave else ''}{force}")
    states = [*([f"x_{i}" for i in motors] if lag else []), *axes, "w"]
    lines = [
        'schema = "rotorid.model/1"',
        'name = "physical.motors"',
        'source = "motor outputs to rates and specific force, linear around hover"',
        f"inputs = [{', '.join(_quoted(f'motor_{i}') for i in motors)}]",
        f"states = [{', '.join(map(_quoted, states))}]",
        "equations = [",
        *(f"    {_quoted(one)}," for one in equations),
        "]",
        f"outputs = [{', '.join(map(_quoted, (*axes, 'az = w' + chr(39))))}]",
        "[delays]",
        *_delays(identified),
        "[constants]",
        f"x_0 = {identified.hover_output!r}",
        *_parameters(identified, axes),
    ]
    return from_toml("\n".join(lines), where="the hover model")


def _quoted(text: str) -> str:
    return f'"{text}"'


def _sum(terms: dict[str, float]) -> str:
    return " + ".join(f"({factor!r})*{name}" for name, factor in terms.items() if factor != 0.0)


def _delays(identified: MotorIdentified) -> list[str]:
    motors = range(1, identified.data.layout.rotors + 1)
    return [f'motor_{i} = "{name}"' for name in _delayed(identified) for i in motors]


def _delayed(identified: MotorIdentified) -> tuple[str, ...]:
    """The delay that stands for all: to the gyros, or where no rate was excited to the accelerometer."""
    names = [one for one in ("tau_gyro", "tau_accel") if one in identified.parameters.names]
    return tuple(names[:1])


def _parameters(identified: MotorIdentified, axes: Sequence[str]) -> list[str]:
    slope = " + ".join(
        term for name, term in (("c_1", "c_1"), ("c_2", "2*c_2*x_0")) if name in identified.parameters.names
    )
    used = {"m", "c_1", "c_2", "Z_w", "T_motor", *_delayed(identified)}
    used |= {name for axis in axes for name in (_DAMPING[axis], _INERTIA[axis].removeprefix("1/"))}
    lines: list[str] = []
    for one in identified.parameters:
        if one.name not in used:
            continue
        held = ['status = "fixed"'] if one.status != "free" else []
        lines += [f"[parameters.{one.name}]", f"value = {one.value!r}", f'unit = "{one.unit}"', *held]
    tied = {f"{axis}_thrust": (f"({slope})*{_INERTIA[axis]}".replace("*1/", "/"), "1/(kg m^2)") for axis in axes}
    tied["az_thrust"] = (f"({slope})/m", "m/s^2")
    for name, (expression, _) in tied.items():
        unit = "m/s^2" if name == "az_thrust" else "rad/(m s^2)" if name != "r_thrust" else "rad/s^2"
        lines += [f"[parameters.{name}]", f'tied = "{expression}"', f'unit = "{unit}"']
    return lines
