"""Words that people use for commands and targets of other names, for errors that suggest the right one."""

from collections.abc import Mapping
from types import MappingProxyType

COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("analyze", "analyse", "analysis", "report", "summary", "log", "check"), "review"),
        **dict.fromkeys(("info", "show", "cat", "ls", "look", "channels", "topics", "read"), "inspect"),
        **dict.fromkeys(("bode", "frf", "frequency", "fft", "spectrum", "tf", "frequency_response"), "response"),
        **dict.fromkeys(("plot", "gui", "ui", "serve", "web", "browser", "view"), "lab"),
        **dict.fromkeys(("fit", "id", "ident", "sysid", "estimate", "model", "n4sid", "tfest", "ssest"), "identify"),
        **dict.fromkeys(("validate", "test", "residuals"), "verify"),
        **dict.fromkeys(("diff", "comparison"), "compare"),
        **dict.fromkeys(("latency", "lag"), "delay"),
        **dict.fromkeys(("plan", "sweep", "chirp", "excite", "experiment", "doublet", "multisine"), "design"),
        **dict.fromkeys(("sim", "fly", "simulator", "replay"), "simulate"),
        **dict.fromkeys(("schedule", "interpolate", "join"), "stitch"),
        **dict.fromkeys(("autotune", "auto-tune", "tuning", "pid", "gains", "optimize", "optimise"), "tune"),
        **dict.fromkeys(("convert", "save", "write", "sitl", "gazebo", "matlab", "simulink", "urdf", "fmu"), "export"),
        **dict.fromkeys(("batch", "many", "folder", "database"), "fleet"),
        **dict.fromkeys(("benchmark", "benchmarks", "leaderboard"), "bench"),
        **dict.fromkeys(("monitor", "watch", "health", "follow"), "track"),
        **dict.fromkeys(("library", "list", "list-models"), "models"),
        **dict.fromkeys(("airframes", "drones", "aircraft"), "vehicles"),
        **dict.fromkeys(("sample", "samples", "examples", "data"), "example"),
        **dict.fromkeys(("quickstart", "tutorial", "start"), "demo"),
        **dict.fromkeys(("diagnose", "selftest", "self-test", "env"), "doctor"),
        "version": "--version",
        "help": "--help",
    }
)
"""Word to the command that does it."""

TARGETS: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("px4", "sih", "px4_sih", "px4-sitl", "px4_sitl", "jmavsim"), "px4-sih"),
        "sitl": "px4-sih or ardupilot",
        **dict.fromkeys(("apm", "ardupilot-sitl", "ardupilot_sitl", "copter", "arducopter"), "ardupilot"),
        **dict.fromkeys(("mixer", "mmix", "betaflight", "lua", "motors", "ca_rotor", "matrix"), "allocation"),
        "simulink": "matlab or fmu",
        **dict.fromkeys(("octave", "m", "mat", "mlx"), "matlab"),
        **dict.fromkeys(("python", "python-control", "ss", "scipy", "statespace"), "control"),
        **dict.fromkeys(("sdf", "gz", "ignition", "gazebo-classic"), "gazebo"),
        **dict.fromkeys(("mjcf", "xml"), "mujoco"),
        **dict.fromkeys(("l2f", "raptor", "rl_tools", "rltools"), "rl-tools"),
        **dict.fromkeys(("drone-models", "drone_models", "toml"), "crazyflow"),
        **dict.fromkeys(("aerial_gym", "aerialgym", "isaac-gym", "isaacgym"), "aerial-gym"),
        **dict.fromkeys(("agilicious", "flightlib"), "flightmare"),
        **dict.fromkeys(("ros", "ros2", "rviz", "pybullet", "isaac"), "urdf"),
        **dict.fromkeys(("fmi", "modelica", "dymola", "openmodelica"), "fmu"),
    }
)
"""Word to the target of ``rotorid export`` that is meant."""

BENCHMARKS: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("nano-drone", "nano_drone", "nanodrone", "busetto"), "idsia"),
        **dict.fromkeys(("neuro-bem", "neuro_bem", "bem", "uzh"), "neurobem"),
        **dict.fromkeys(("nano-bench", "nano_bench"), "nanobench"),
    }
)
"""Word to the public benchmark that is meant."""
