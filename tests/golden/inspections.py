"""What ``inspect`` says about every kind of log in the data folder.

Written down by ``python -m tests.golden.inspections``.
A person looks at the difference before it is kept: no test writes it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from tests.golden.results import DATA

import rotorid

GOLDEN = Path(__file__).resolve().parent / "inspect.json"
MAPPINGS = Path(__file__).resolve().parents[2] / "docs" / "mappings"
MAPS = {
    "antx/prbs.mat": "antx/map.toml",
    "antx/sweep.mat": "antx/map.toml",
    "bebop/ident/120935.mat": "bebop/map.toml",
    "bebop/sim/120935.mat": "bebop/map.toml",
    "bebop/sim/121250.mat": MAPPINGS / "bebop_random_binary.toml",
    "bebop/unfiltered/120935.mat": MAPPINGS / "bebop_random_binary.toml",
    "bebop/step/20Hz_0_62_log_09052019_101948.mat": MAPPINGS / "bebop_steps.toml",
    "bebop/steadystate/20Hz_0_62_log_09052019_101948.mat": MAPPINGS / "bebop_steps.toml",
    "bebop/command_rate/5Hz_62_log_09052019_100955.mat": MAPPINGS / "bebop_steps.toml",
    "bebop/command_rate/100Hz_62_log_09052019_100647.mat": MAPPINGS / "bebop_steps.toml",
    "bebop/yaw_drift/0_20Hz_log_09052019_121835.mat": MAPPINGS / "bebop_steps.toml",
    "bebop/yaw_drift/0_yawDriftmetC_constant1_log_03052019_144521.mat": MAPPINGS / "bebop_time_steps.toml",
    "iris_sim/quadrotor_model.csv": MAPPINGS / "gazebo_iris.toml",
    "polimi/input.mat": MAPPINGS / "pitch_rig_two_files.toml",
}
LOGS = (
    *MAPS,
    *("ardupilot/beast_0036.BIN", "ardupilot/erle_brain3.BIN", "ardupilot/truncated_80k.BIN"),
    *("ardupilot_sitl/x_calm_roll.BIN", "ardupilot_sitl/x_calm_thrust.BIN.xz", "ardupilot_sitl/x_calm_verify.BIN.xz"),
    *("ardupilot_sitl/x_wind_rollpitch.BIN.xz", "ardupilot_sitl/x_wind_yawthrust.BIN.xz"),
    *("betaflight/smooth_tune.BBL", "crazyflie/log10", "px4/zmr250"),
    *("px4/s250_2017.ulg", "px4/sample.ulg", "px4/sample_log_small.ulg", "px4/sample_old_1MB.ulg"),
    "px4/sample_logging_tagged_and_default_params.ulg",
    *(f"px4_sitl/{name}" for name in ("pitch.ulg.xz", "roll.ulg", "thrust.ulg.xz", "verify.ulg.xz", "yaw.ulg.xz")),
    *(f"s500/{axis}_{what}.csv" for axis in ("roll", "pitch", "yaw", "thrust") for what in ("sweeps", "doublets")),
)


def facts(log: str, folder: Path) -> dict[str, Any]:
    """The little that should not change by accident."""
    mapping = MAPS.get(log)
    # The files are known, so that no child process has to guard against them.
    record = rotorid.read(folder / log, mapping=folder / mapping if mapping else None, sandbox=False)
    document = rotorid.inspect(record)
    return {
        "format": document.format,
        "channels": " ".join(sorted({channel.name for channel in document.channels})),
        "rates_hz": " ".join(sorted({f"{channel.rate_hz:.3g}" for channel in document.channels}, key=float)),
        "findings": " ".join(sorted({finding.kind for finding in document.findings})),
        "candidates": [f"{c.axis} {c.kind} {c.start_s:.2f} {c.stop_s:.2f}" for c in document.candidates],
        "excitations": [f"{e.axis} {e.kind} {e.start_s:.2f} {e.stop_s:.2f}" for e in document.excitations],
        "supports": " ".join(sorted(model for model, support in document.supports.items() if support.possible)),
    }


def main() -> None:
    """Write down what all logs say."""
    if not DATA.is_dir():
        sys.exit(f"no flight data at {DATA}; set ROTORID_DATA to their folder")
    text = json.dumps({log: facts(log, DATA) for log in LOGS}, indent=1)
    GOLDEN.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
