"""The targets by name: what each is, and where it is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.data import synonyms
from rotorid.data.base import Immutable
from rotorid.errors import unknown_name


@dataclass(frozen=True, kw_only=True)
class Target(Immutable):
    """A tool that a vehicle can be exported to.

    Parameters
    ----------
    name
        As people type it.
    summary
        What is written, in a line.
    module
        Module of this package whose function ``export`` makes it.
    scale
        Whether it needs a vehicle in kilograms and meters; state spaces and motor factors do not.
    states
        Whether it has linear models, with delays as states and a sample rate.
    lag
        Whether its motors have a lag, to which a delay can be added.
    together
        Whether drawn vehicles are written for one loader, by the function ``together`` of its module.
    """

    name: str
    summary: str
    module: str
    scale: bool = True
    states: bool = False
    lag: bool = True
    together: bool = False


TARGETS: Mapping[str, Target] = {
    target.name: target
    for target in (
        Target(name="px4-sih", summary="PX4 simulation-in-hardware: parameters and an airframe", module="px4_sih"),
        Target(
            name="ardupilot", summary="ArduPilot SITL: a frame as JSON, and parameters", module="ardupilot", lag=False
        ),
        Target(name="gazebo", summary="Gazebo with rotors of MulticopterMotorModel: SDF", module="gazebo"),
        Target(name="mujoco", summary="MuJoCo: MJCF with a hovering keyframe", module="mujoco"),
        Target(name="rotorpy", summary="RotorPy: a Python file with its parameters", module="rotorpy"),
        Target(name="urdf", summary="gym-pybullet-drones: URDF", module="urdf", lag=False),
        Target(
            name="rl-tools", summary="rl-tools, l2f and RAPTOR: the dynamics as JSON", module="rl_tools", together=True
        ),
        Target(
            name="crazyflow", summary="crazyflow and drone-models: a section of TOML", module="crazyflow", together=True
        ),
        Target(name="pyflyt", summary="PyFlyt: a folder with URDF and YAML", module="pyflyt", together=True),
        Target(
            name="aerial-gym",
            summary="Aerial Gym: a configuration in Python, and URDF",
            module="aerial_gym",
            together=True,
        ),
        Target(name="flightmare", summary="Flightmare: a block of its YAML", module="flightmare", together=True),
        Target(
            name="allocation",
            summary="Motor factors for ArduPilot (Lua), Betaflight (mmix) and PX4 (CA_ROTOR)",
            module="allocation",
            scale=False,
            lag=False,
        ),
        Target(
            name="matlab",
            summary="MATLAB, Simulink and Octave: .mat and a script",
            module="matlab",
            scale=False,
            states=True,
        ),
        Target(name="control", summary="python-control: a script", module="control", scale=False, states=True),
        Target(
            name="fmu", summary="Simulink and Modelica: FMI 2.0 co-simulation", module="fmu", scale=False, states=True
        ),
        Target(
            name="json",
            summary="The models with their covariance, as JSON",
            module="json_model",
            scale=False,
            states=True,
        ),
    )
}


def target_named(name: str) -> Target:
    """A target by its name.

    Parameters
    ----------
    name
        As ``export --to`` takes it.

    Raises
    ------
    UsageError
        There is none of this name.

    Examples
    --------
    >>> target_named("mujuco")
    Traceback (most recent call last):
    ...
    rotorid.errors.UsageError: unknown target 'mujuco'; did you mean mujoco?
    """
    if name in TARGETS:
        return TARGETS[name]
    raise unknown_name("target", name, TARGETS, synonyms=synonyms.TARGETS, see="rotorid export --help")
