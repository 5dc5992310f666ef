"""Paper 3, thrust, inertia and motors by a genetic algorithm: what proves each line.

Print: tables 1 and 2. Its inertias break the triangle inequality, so that the twin is PX4's quadrotor of 1 kg.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from tests.docs.papers_checks import Estimate, Fact, Line, Number, drawn, field, has_kind, no_kind, of, parameter, truth
from tests.docs.papers_page import Runs

import rotorid
from rotorid.models import check_inertia, check_mixer
from rotorid.vehicles import hover_quadrotor, px4

I_XX, I_YY, I_ZZ = px4.INERTIA_KG_M2
KAPPA_M = px4.TORQUE_N_M / px4.THRUST_N
TRUE: dict[str, Callable[[Runs], float] | float] = {
    "I_xx": I_XX,
    "I_yy": I_YY,
    "L_p": truth("px4", "L_p"),
    "M_q": truth("px4", "M_q"),
    "N_r": truth("px4", "N_r"),
    "Z_w": truth("px4", "Z_w"),
    "X_u": truth("px4", "X_u"),
    "Y_v": truth("px4", "Y_v"),
    "T_motor": px4.LAG_S,
    "kappa_per_I_zz": KAPPA_M / I_ZZ,
    "c_1": px4.THRUST_N,
}
SPREADS = {"c_t": 0.012 / 1.415, "I_xx": 0.005 / 0.161, "I_yy": 0.006 / 0.199, "I_zz": 0.015 / 1.148}
"""Table 2: deviation over mean of a hundred runs."""


def all_of(run: str, *names: str) -> tuple[Number, ...]:
    return tuple(Number(f"{run}: {name}", parameter(run, name), truth=TRUE[name]) for name in names)


def derived(run: str, name: str) -> Callable[[Runs], Estimate]:
    def found(runs: Runs) -> Estimate:
        one = runs[run].document["motors"]["derived"][name]
        return Estimate(one["value"], one["std"])

    return found


def leans(runs: Runs) -> float:
    """Acceleration to the north over that which thrust and attitude make, without the small angles of the paper."""
    record = rotorid.read(runs["px4"].folder / "flight.ulg")
    names = ("phi", "theta", "psi", "velocity_north", "velocity_down")
    history = rotorid.resample(record, channels=names, start_s=40.0, stop_s=90.0, sample_rate_hz=50.0).histories[0]
    phi, theta, psi = (history[name] for name in names[:3])
    north, down = (np.gradient(history[name], 0.02) for name in names[3:])
    drag = px4.DRAG_N_S_M / px4.MASS_KG
    lifted = (9.80665 - down - drag * history["velocity_down"]) / (np.cos(phi) * np.cos(theta))
    made = (
        -lifted * (np.sin(psi) * np.sin(phi) + np.cos(psi) * np.sin(theta) * np.cos(phi))
        - drag * history["velocity_north"]
    )
    smooth = np.ones(10) / 10.0
    made, north = np.convolve(made, smooth, "valid"), np.convolve(north, smooth, "valid")
    return float(np.dot(made, north) / np.dot(made, made))


def noise_again(run: str, name: str) -> Callable[[Runs], Estimate]:
    def found(runs: Runs) -> Estimate:
        one = runs[run].document["bootstrap"]["parameters"][name]
        return Estimate(one["mean"], one["std"])

    return found


def motor_range(runs: Runs) -> tuple[float, float]:
    record = rotorid.read(runs["px4"].folder / "flight.ulg")
    history = rotorid.resample(
        record, channels=("motor_1",), start_s=record.start_s + 1.0, stop_s=record.stop_s - 1.0, sample_rate_hz=100.0
    ).histories[0]
    return float(history["motor_1"].min()), float(history["motor_1"].max())


def pulses(runs: Runs) -> tuple[float, float]:
    """Ends of an output that a table holds as pulses, with the range that its mapping states."""
    table, mapping = runs.root / "pulses.csv", runs.root / "pulses.toml"
    width_us = 1500.0 + 400.0 * np.sin(0.1 * np.pi * np.arange(2000))
    rows = "".join(f"{0.01 * k},{width},{np.sin(0.3 * k)}\n" for k, width in enumerate(width_us))
    table.write_text(f"t,u0,gyro_y\n{rows}", encoding="utf-8")
    mapping.write_text(
        'clock = "t"\nchannels.q = "gyro_y [rad/s]"\nchannels.motor_1 = { source = "u0", range = [1100, 1900] }\n',
        encoding="utf-8",
    )
    record = rotorid.read(table, mapping=mapping)
    found = [
        values
        for topic in record.topics
        for channel, values in zip(topic.channels, topic.values, strict=True)
        if channel.name == "motor_1"
    ]
    return float(found[0].min()), float(found[0].max())


def search_of(run: str) -> Callable[[Runs], Any]:
    return lambda runs: runs[run].document["search"]


def run_mean(runs: Runs, name: str) -> Estimate:
    one = runs["motors-runs"].document["noise_runs"]["parameters"][name]
    return Estimate(one["mean"], one["std"])


def run_spread(runs: Runs, name: str) -> float:
    one = run_mean(runs, name)
    return (one.std or 0.0) / one.value


def log_ratio(runs: Runs, place: int) -> Estimate:
    one = runs["motors-two"].document["motors"]["logs"][place]
    return Estimate(one["ratio"], one["std"])


def sih(runs: Runs, name: str) -> float:
    """A parameter of the written file."""
    text = next(
        file
        for file in runs["motors-export"].folder.iterdir()
        if name in file.read_text(encoding="utf-8") and file.suffix != ".json"
    )
    words = (
        next(line for line in text.read_text(encoding="utf-8").splitlines() if name in line).replace(",", " ").split()
    )
    return float(
        next(word for word in reversed(words) if word.replace(".", "").replace("e-", "").isdigit() and "." in word)
    )


LINES = (
    Line(
        "px4",
        "positions from thrust",
        Number(
            "acceleration over that of thrust and attitude",
            leans,
            truth=1.0,
            within=0.05,
            because="differentiated velocity",
        ),
    ),
    Line(
        "motors",
        "U₁ to U₄",
        Fact(
            "rotors and spins are the vehicle's",
            lambda runs: (
                np.allclose(runs["motors"].document["motors"]["rotors"], px4.layout().positions, atol=1e-3)
                and runs["motors"].document["motors"]["spins"] == px4.layout().spins.tolist()
            ),
        ),
    ),
    Line(
        "motors",
        "mixer of rank three",
        no_kind("motors", "singular_mixer", "impossible_physics"),
        Fact(
            "the printed mixer is one",
            lambda _: [one.kind for one in check_mixer(hover_quadrotor.printed_mixer())] == ["singular_mixer"],
        ),
        Fact(
            "the printed inertia is impossible",
            lambda _: [one.kind for one in check_inertia(0.16, 0.20, 1.15)] == ["impossible_physics"],
        ),
    ),
    Line(
        "motors",
        "mass and arm measured",
        Number("m [kg]", parameter("motors", "m"), truth=px4.MASS_KG, paper=1.023, within=1e-9),
        Number("arm [m]", field("motors", "motors", "arm_m"), truth=px4.ARM_M, paper=0.23, within=1e-4),
        *all_of("motors", "I_xx", "I_yy"),
    ),
    Line(
        "motors",
        "thrust of a rotor",
        Number("thrust in hover [N]", derived("motors", "thrust_hover"), truth=px4.MASS_KG * 9.80665 / 4.0),
        Number("slope of thrust [N]", derived("motors", "thrust_slope"), truth=px4.THRUST_N),
        Number("c_1 [N]", parameter("motors", "c_1"), truth=px4.THRUST_N),
        drawn("motors", "motors-curve", curves=1, bands=1),
    ),
    Line("motors", "motor lag G(s)", *all_of("motors", "T_motor", "L_p", "M_q", "Z_w")),
    Line(
        "motors",
        "ẍ, ÿ from thrust",
        *all_of("motors", "X_u", "Y_v"),
        *(
            Number(f"{name} explained [%]", field("motors", "fit_percent", name), least=50.0)
            for name in ("velocity_forward_dot", "velocity_right_dot")
        ),
    ),
    Line(
        "motors",
        "15 individuals",
        Number("evaluations", field("motors", "search", "evaluations"), paper=750, within=0),
        Number("individuals", lambda runs: runs["motors"].document["search"]["trace"][0][0], paper=15, within=0),
        Number("generations", lambda runs: len(runs["motors"].document["search"]["trace"]), paper=50, within=1),
    ),
    Line(
        "motors",
        "fitness, sum of absolute errors",
        Fact(
            "the objective is that of accelerations",
            lambda runs: search_of("motors")(runs)["objective"] == "accelerations",
        ),
        Number(
            "cost of the search alone over that after a local search",
            lambda runs: search_of("motors")(runs)["alone"]["cost"] / search_of("motors")(runs)["minima"][0]["cost"],
            least=1.0,
        ),
    ),
    Line(
        "motors",
        "fitness over generations",
        Fact("it falls", lambda runs: np.all(np.diff([cost for _, cost in search_of("motors")(runs)["trace"]]) <= 0.0)),
        drawn("motors", "search-cost", curves=1),
    ),
    Line(
        "motors",
        "log at 100 Hz",
        Number("outputs [Hz]", field("motors", "motors", "outputs_rate_hz"), paper=100.0, least=100.0),
        no_kind("motors", "rate_too_low"),
    ),
    Line(
        "motors",
        "table 1",
        *all_of("motors", "I_xx", "I_yy", "kappa_per_I_zz"),
        Number("I_zz [kg m²]", parameter("motors", "I_zz"), truth=I_ZZ),
        Fact("the table is LaTeX", lambda runs: "tabular" in runs["motors"].text("tables/parameters.tex")),
    ),
    Line("motors", "fig 1", drawn("motors", "motors-flight-0", panels=6, curves=12)),
    Line(
        "motors",
        "agreement in numbers",
        *(
            Number(f"{name} explained [%]", field("motors", "fit_percent", name), least=least)
            for name, least in (("az", 80.0), ("p_dot", 80.0), ("q_dot", 80.0), ("r_dot", 50.0))
        ),
    ),
    Line(
        "motors",
        "model on an unseen flight",
        Number(
            "p_dot, unseen [%]",
            lambda runs: next(iter(runs["motors"].document["verification"]["records"].values()))["p_dot"][
                "nrmse_fit_percent"
            ],
            least=80.0,
        ),
    ),
    Line(
        "motors-angles",
        "z̈ from height",
        has_kind("motors-angles", "differentiated"),
        *all_of("motors-angles", "I_xx", "I_yy", "T_motor"),
        Fact("yaw too", lambda runs: "kappa_per_I_zz" in runs["motors-angles"].document["parameters"]),
        pending="yaw is not found from its angle",
    ),
    Line(
        "motors-runs",
        "table 2",
        Number("runs", field("motors-runs", "noise_runs", "runs"), paper=100, within=0),
        *(
            Number(f"{name}, mean of runs", of(run_mean, name), truth=value)
            for name, value in (("I_xx", I_XX), ("I_yy", I_YY))
        ),
        *(
            Number(
                f"{name}, spread of runs",
                of(run_spread, name),
                paper=SPREADS[name],
                most=SPREADS[name],
            )
            for name in ("I_xx", "I_yy")
        ),
    ),
    Line(
        "motors-plain",
        "κ and I_z are one ratio",
        *all_of("motors-plain", "kappa_per_I_zz", "I_xx", "I_yy", "T_motor", "c_1"),
        Fact(
            "neither is there alone",
            lambda runs: not {"kappa", "I_zz"} & set(runs["motors-plain"].document["parameters"]),
        ),
    ),
    Line(
        "motors-plain",
        "noise filtered before",
        has_kind("motors-plain", "known_filter"),
        Number("tau_gyro [s]", parameter("motors-plain", "tau_gyro"), truth=0.0),
    ),
    Line(
        "motors-noise",
        "noise drawn again",
        Number("runs", field("motors-noise", "bootstrap", "runs"), paper=200, within=0),
        Number("I_xx, mean over noise", noise_again("motors-noise", "I_xx"), truth=I_XX),
        Number(
            "spread of I_xx over its random error",
            lambda runs: (
                (noise_again("motors-noise", "I_xx")(runs).std or 0.0)
                / runs["motors-noise"].document["parameters"]["I_xx"]["std_random"]
            ),
            least=0.3,
            most=3.0,
        ),
    ),
    Line(
        "motors-evolution",
        "other searches",
        *all_of("motors-evolution", "I_xx", "I_yy"),
        Fact("it is evolution", lambda runs: search_of("motors-evolution")(runs)["name"] == "evolution"),
    ),
    Line(
        "motors-two",
        "battery and payload",
        *(
            Number(
                f"thrust of log {place + 1} over the mean",
                of(log_ratio, place),
                truth=1.0,
            )
            for place in (0, 1)
        ),
        no_kind("motors-two", "payload_step", "voltage_exponent", "battery_sag"),
    ),
    Line(
        "motors-export",
        "model for control",
        Fact(
            "what is held is the result's",
            lambda runs: all(
                abs(one["difference_percent"]) < 0.1
                for one in runs["motors-export"].document["quantities"]
                if one["held"] == "exact"
            ),
        ),
        Fact(
            "accelerations and lag are held",
            lambda runs: sum(one["held"] == "exact" for one in runs["motors-export"].document["quantities"]) >= 5,
        ),
        Number(
            "I_xx of the file [kg m²]",
            lambda runs: sih(runs, "SIH_IXX"),
            truth=lambda runs: parameter("motors", "I_xx")(runs).value,
            within=1e-4,
        ),
    ),
    Line(
        "motors-flown",
        "from model to simulation",
        Number(
            "M_pitch flown [rad/s²]",
            truth("motors-flown", "M_pitch"),
            truth=truth("px4", "M_pitch"),
            within=6.0,
            because="twice the error of I_yy",
        ),
        Number(
            "T_motor flown [s]",
            truth("motors-flown", "T_motor"),
            truth=lambda runs: parameter("motors", "T_motor")(runs).value,
            within=1e-4,
        ),
    ),
    Line(
        "rotorid inspect px4/flight.ulg --json",
        "output normalized",
        Number("lowest output", lambda runs: motor_range(runs)[0], least=0.0, most=0.2),
        Number("highest output", lambda runs: motor_range(runs)[1], least=0.8, most=1.0),
        Number("pulses as a share of their range, lowest", lambda runs: pulses(runs)[0], truth=0.0, within=1e-6),
        Number("pulses as a share of their range, highest", lambda runs: pulses(runs)[1], truth=1.0, within=1e-6),
    ),
)
