"""Paper 2, an S500 in hover: what proves each line. Print: tables 1 to 8; the eigenvalues of table 5 are wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from tests.docs.papers_checks import (
    Estimate,
    Fact,
    Line,
    Number,
    drawn,
    field,
    has_kind,
    of,
    parameter,
    printed,
    truth,
)
from tests.docs.papers_page import Runs

from rotorid.models.state_space import StateSpace
from rotorid.vehicles import s500

LONGITUDINAL, LATERAL = "six/hover.longitudinal", "six/hover.lateral"
TABLE_4 = (
    "M_q",
    "M_u",
    "M_w",
    "X_q",
    "X_u",
    "Z_u",
    "Z_w",
    "M_pitch",
    "X_pitch",
    "Z_pitch",
    "Z_thrust",
    "tau_pitch",
    "tau_thrust",
)
TABLE_7 = ("L_r", "L_v", "N_p", "N_r", "Y_p", "Y_v", "L_roll", "N_roll", "Y_roll", "N_yaw", "tau_roll")
TABLE_3: Mapping[str, tuple[float, float, float]] = {
    "q/pitch_command": (3.0, 45.0, 54.2),
    "ax/pitch_command": (5.0, 35.0, 29.6),
    "az/pitch_command": (9.0, 20.0, 21.1),
    "u_dot/pitch_command": (2.1, 11.0, 30.0),
    "az/thrust_command": (0.81, 21.0, 12.2),
    "w_dot/thrust_command": (0.81, 21.0, 17.7),
}
LOWEST_3 = 4.0 * math.pi / 9.0
"""Two periods in the longest window of table 2."""
TABLE_6: Mapping[str, tuple[float, float, float]] = {
    "p/roll_command": (4.5, 30.0, 25.7),
    "r/roll_command": (9.6, 20.0, 22.9),
    "phi/roll_command": (5.0, 13.0, 7.3),
    "v_dot/roll_command": (4.0, 28.0, 19.9),
    "ay/roll_command": (5.0, 27.0, 27.0),
    "r/yaw_command": (1.0, 21.0, 96.8),
}


def table(run: str, names: tuple[str, ...], *but: str) -> tuple[Number, ...]:
    """Parameters against what flew, next to print."""
    return tuple(
        Number(name, parameter(run, name), truth=truth("s500", name), paper=s500.TRUTH[name])
        for name in names
        if name not in but
    )


def first_damping(run: str, name: str) -> Number:
    """The damping of the first step, whose error its finding has: the second step holds the value."""

    def found(runs: Runs) -> Estimate:
        findings = runs[run].document["findings"]
        one = next(one for one in findings if one["kind"] == "speed_damping_first" and one["where"] == name)
        return Estimate(one["numbers"]["value"], one["numbers"]["std"])

    return Number(f"{name}, of the first step [1/s]", found, truth=truth("s500", name), paper=s500.TRUTH[name])


def bands(
    run: str, printed_bands: Mapping[str, tuple[float, float, float]], lowest_rad_s: float = 0.0
) -> tuple[Number, ...]:
    """Bands and costs of all responses: points of the grid begin and end within a tenth of the printed band.

    None begins below two periods in the longest window, of which the paper takes one.
    """
    found: list[Number] = []
    for pair, (low, high, cost) in printed_bands.items():
        low = max(low, lowest_rad_s)
        path = ("cost", "pairs", pair)
        found += [
            Number(
                f"{pair}, from [rad/s]",
                field(run, *path, "band_rad_s", 0),
                paper=low,
                within=0.1 * low,
                because="points of the grid",
            ),
            Number(
                f"{pair}, to [rad/s]",
                field(run, *path, "band_rad_s", 1),
                paper=high,
                within=0.1 * high,
                because="points of the grid",
            ),
            Number(f"{pair}, cost", field(run, *path, "value"), paper=cost, most=100.0),
        ]
    return tuple(found)


def pole(run: str, which: int, part: str) -> Callable[[Runs], Estimate]:
    """Real or imaginary part of a pole above the real axis, slowest first."""

    def found(runs: Runs) -> Estimate:
        poles = sorted((one for one in runs[run].document["poles"] if one["imag"] >= 0.0), key=lambda one: one["real"])
        return Estimate(poles[which][part], poles[which][f"{part}_std"])

    return found


def true_pole(system: StateSpace, which: int, part: str) -> float:
    poles = sorted((one for one in system.poles() if one.imag >= -1e-9), key=lambda one: one.real)
    return float(getattr(poles[which], part))


def eigenvalues(run: str, system: StateSpace, *wanted: tuple[int, str, float]) -> tuple[Number, ...]:
    return tuple(
        Number(
            f"{run}: pole {which + 1}, {part} [rad/s]",
            pole(run, which, part),
            truth=true_pole(system, which, part),
            paper=paper,
        )
        for which, part, paper in wanted
    )


def misfit(
    runs: Runs, run: str, pair: tuple[str, str], system: StateSpace, names: tuple[str, ...], inputs: tuple[str, ...]
) -> float:
    """Root mean square of a response over the true one, in its own random errors and those of two percent together."""
    file = runs[run].arrays()
    y, u = (
        [str(name) for name in file[key]].index(name) for key, name in zip(("outputs", "inputs"), pair, strict=True)
    )
    exact = system.response(file["omega_rad_s"])[names.index(pair[0]), inputs.index(pair[1])]
    used = file["used"][y, u]
    off = abs(file["values"][y, u] / exact - 1.0) / np.hypot(file["random_error"][y, u], 0.02)
    return float(np.sqrt(0.5 * np.mean(off[used] ** 2)))


def long_misfit(runs: Runs, output: str, input: str) -> float:
    names = ("q", "u", "w", "theta", "ax", "az")
    return misfit(
        runs, "s500-response", (output, input), s500.longitudinal(), names, ("pitch_command", "thrust_command")
    )


def doublets(run: str, axis: str) -> Callable[[Runs], float]:
    """Least share of the main output that is explained in doublets of an axis, in open loop."""
    output = {"thrust": "az", "yaw": "r", "pitch": "q", "roll": "p"}[axis]

    def found(runs: Runs) -> float:
        checks = runs[run].document["verification"]["maneuvers"]
        return min(
            one["scores"][output]["nrmse_fit_percent"]
            for one in checks
            if one["axis"] == axis and output in one["scores"]
        )

    return found


def sweeps(runs: Runs, run: str, shape: str) -> list[dict[str, Any]]:
    return [one for one in runs[run].json("plan.json")["inputs"] if one["shape"] == shape]


def corrected(runs: Runs) -> float:
    """Largest deviation of the corrected roll response from what it is without, which for perfect sensors is none."""
    plain, other = runs["s500-cut"].arrays(), runs["s500-sensors"].arrays()
    gain = [
        float(
            np.median(
                abs(
                    one["values"][0, 0][one["used"][0, 0] & (one["omega_rad_s"] > 8.0)]
                    * 1j
                    * one["omega_rad_s"][one["used"][0, 0] & (one["omega_rad_s"] > 8.0)]
                )
            )
        )
        for one in (plain, other)
    ]
    return gain[1] / gain[0] - 1.0


def four_in_sight(runs: Runs) -> bool:
    page = runs["s500-axes"].text("report.html")
    seen = page[page.index('id="of-responses"') :].partition("off-axis response")[0]
    return all(f"response-{number}" in seen for number in range(4)) and "response-4" not in seen


def inspected(runs: Runs) -> dict[str, Any]:
    found: dict[str, Any] = runs.json_of("rotorid inspect s500/flight.ulg --json")
    return found


def long_gain(runs: Runs) -> Estimate:
    """Gain of the transfer function of pitch at 20 rad/s over the true one."""
    values = {name: one["value"] for name, one in runs["s500-transfer"].document["parameters"].items()}
    s = 20.0j
    found = (values["b1"] * s + values["b0"]) / (s**2 + values["a1"] * s + values["a0"]) * np.exp(-s * values["tau"])
    return Estimate(float(abs(found / s500.longitudinal().response(np.array([20.0]))[0, 0, 0])))


def lateness(runs: Runs) -> float:
    """Its phase at 20 rad/s less the true one, as a delay."""
    values = {name: one["value"] for name, one in runs["s500-transfer"].document["parameters"].items()}
    s = 20.0j
    found = (values["b1"] * s + values["b0"]) / (s**2 + values["a1"] * s + values["a0"]) * np.exp(-s * values["tau"])
    return float(-np.angle(found / s500.longitudinal().response(np.array([20.0]))[0, 0, 0]) / 20.0)


def constants(runs: Runs) -> dict[str, float]:
    found = runs[LONGITUDINAL].document["constants"]
    return {name: float(one["value"] if isinstance(one, dict) else one) for name, one in found.items()}


def kinematic(runs: Runs, channel: str, which: str) -> Estimate:
    one = next(one for one in inspected(runs)["kinematics"] if one["channel"] == channel)
    return Estimate(one[which], one[f"{which}_std"])


LINES = (
    Line(
        "s500-sweeps",
        "eq 1",
        Number("repeats", lambda runs: len(sweeps(runs, "s500-sweeps", "pilot_sweep")), paper=5, within=0),
        Number(
            "longest period [s]",
            lambda runs: 2.0 * math.pi / sweeps(runs, "s500-sweeps", "pilot_sweep")[0]["band_rad_s"][0],
            paper=2.0 * math.pi / 0.7,
            within=0.01,
        ),
        Number(
            "to [rad/s]",
            lambda runs: sweeps(runs, "s500-sweeps", "pilot_sweep")[0]["band_rad_s"][1],
            paper=30.0,
            within=1e-9,
        ),
        Number(
            "length [s]",
            lambda runs: (
                sweeps(runs, "s500-sweeps", "pilot_sweep")[0]["stop_s"]
                - sweeps(runs, "s500-sweeps", "pilot_sweep")[0]["start_s"]
            ),
            paper=21.2,
            within=1.0,
        ),
    ),
    Line(
        "s500-plan",
        "sweeps of four inputs",
        Fact(
            "one on each axis",
            lambda runs: (
                {one["axis"] for one in sweeps(runs, "s500-plan", "pilot_sweep")} == {"roll", "pitch", "yaw", "thrust"}
            ),
        ),
        Fact(
            "doublets on each axis",
            lambda runs: (
                {one["axis"] for one in sweeps(runs, "s500-plan", "doublet")} == {"roll", "pitch", "yaw", "thrust"}
            ),
        ),
    ),
    Line(
        "six",
        "fig 1",
        Fact(
            "the page has both models and their checks",
            lambda runs: all(
                word in runs["six"].text("report.html") for word in ("hover.longitudinal", "hover.lateral", "doublet")
            ),
        ),
    ),
    Line(
        "six",
        "trim U0",
        Fact(
            "hover", lambda runs: all(abs(value) < 1e-9 for name, value in constants(runs).items() if name[0] in "UWtp")
        ),
    ),
    Line(
        "six",
        "one clock",
        Number(
            "rate of the records [Hz]",
            lambda runs: (
                float(runs[LONGITUDINAL].document["records"][0]["sample_rate_hz"])
                if runs[LONGITUDINAL].document.get("records")
                else 250.0
            ),
            paper=200.0,
            least=100.0,
        ),
    ),
    Line(
        "six",
        "cost J of each",
        Number("J_avg, longitudinal", field(LONGITUDINAL, "cost", "average"), paper=26.5, most=50.0),
        Number("J_avg, lateral", field(LATERAL, "cost", "average"), paper=49.9, most=50.0),
        Fact("the table has six responses", lambda runs: len(runs[LONGITUDINAL].table("responses")) == 6),
    ),
    Line(
        "six",
        "Cramér–Rao bound",
        *(
            Number(
                f"Cramér–Rao of {name} [%]",
                field(run, "parameters", name, "cramer_rao_percent"),
                paper=paper,
                most=20.0,
            )
            for run, name, paper in (
                (LONGITUDINAL, "M_u", 13.7),
                (LONGITUDINAL, "M_pitch", 3.1),
                (LATERAL, "L_roll", 2.8),
                (LATERAL, "L_v", 13.8),
            )
        ),
        Fact(
            "what the vehicle lacks is dropped",
            lambda runs: all(
                runs[run].document["parameters"][name]["status"] == "dropped"
                for run, names in (
                    (LONGITUDINAL, ("X_w", "M_thrust", "X_thrust")),
                    (LATERAL, ("L_p", "N_v", "Y_r", "L_yaw", "Y_yaw")),
                )
                for name in names
            ),
        ),
        Fact(
            "what it has stays",
            lambda runs: all(
                runs[run].document["parameters"][name]["status"] == "free"
                for run, names in ((LONGITUDINAL, TABLE_4), (LATERAL, TABLE_7))
                for name in names
            ),
        ),
    ),
    Line(
        "six",
        "tables 4, 7",
        *table(LONGITUDINAL, TABLE_4),
        *table(LATERAL, TABLE_7),
        Fact(
            "LaTeX",
            lambda runs: all("tabular" in runs[run].text("tables/parameters.tex") for run in (LONGITUDINAL, LATERAL)),
        ),
    ),
    Line(
        "six",
        "tables 5, 8",
        *eigenvalues(
            LONGITUDINAL,
            s500.longitudinal(),
            (0, "real", -3.81),
            (1, "real", -0.19),
            (2, "real", 2.66),
            (2, "imag", 3.82),
        ),
        *eigenvalues(
            LATERAL, s500.lateral(), (0, "real", -3.88), (0, "imag", 0.62), (1, "real", 1.87), (1, "imag", 3.58)
        ),
        drawn(LONGITUDINAL, "poles", panels=1),
    ),
    Line(
        "six",
        "figs 5, 7",
        Number("a_z of a collective doublet [%]", doublets(LONGITUDINAL, "thrust"), least=80.0),
        Number("r of a pedal doublet [%]", doublets(LATERAL, "yaw"), least=80.0),
        drawn(LONGITUDINAL, "check-2", "measured", panels=2, curves=4),
        drawn(LATERAL, "check-2", "measured", panels=2, curves=4),
    ),
    Line(
        "six",
        "fig 6",
        drawn(
            LONGITUDINAL,
            "responses-pitch_command",
            "measured",
            "model",
            "magnitude",
            "phase",
            "coherence",
            panels=6,
            curves=8,
            bands=4,
        ),
    ),
    Line(
        "six",
        "figs 8 to 10",
        drawn(
            LATERAL,
            "responses-roll_command",
            "measured",
            "model",
            "magnitude",
            "phase",
            "coherence",
            panels=6,
            curves=8,
            bands=4,
        ),
    ),
    Line(
        "six",
        "unstable modes",
        *(
            Number(f"cost of {pair}, unseen", field(run, "verification", "frequency", pair), most=50.0)
            for run, pair in (
                (LONGITUDINAL, "q/pitch_command"),
                (LONGITUDINAL, "ax/pitch_command"),
                (LATERAL, "p/roll_command"),
                (LATERAL, "ay/roll_command"),
            )
        ),
    ),
    Line(
        "six",
        "delays of about 40 ms",
        *table(LONGITUDINAL, ("tau_pitch", "tau_thrust")),
        *table(LATERAL, ("tau_roll",)),
    ),
    Line(
        "six",
        "one model of six",
        Number("states", lambda runs: len(runs["six/hover.joined"].document["states"]), paper=8, within=0),
        *(
            Number(
                f"joined {name}", parameter("six/hover.joined", name), truth=truth("s500", name), paper=s500.TRUTH[name]
            )
            for name in ("M_pitch", "L_roll", "Z_thrust", "N_yaw")
        ),
    ),
    Line(
        "s500-verified",
        "trim offsets",
        Fact(
            "each check has them",
            lambda runs: all(
                one["trim"] and one["biases"] and all("reference_shift" in score for score in one["scores"].values())
                for one in runs["s500-verified"].document["maneuvers"]
            ),
        ),
        Number(
            "reference shift of a_z [m/s²]",
            lambda runs: runs["s500-verified"].document["maneuvers"][0]["scores"]["az"]["reference_shift"],
            truth=-9.80665,
            within=0.2,
            because="gravity",
        ),
    ),
    Line(
        "s500-verified",
        "J_rms",
        Number(
            "J_rms at worst",
            lambda runs: max(one["j_rms"] for one in runs["s500-verified"].document["maneuvers"]),
            most=8.0,
            paper=32.0,
        ),
        Fact(
            "both guidelines",
            lambda runs: (
                runs["s500-verified"].document["j_rms_guideline"]["root"] == [4.0, 8.0]
                and runs["s500-verified"].document["j_rms_guideline"]["printed"] == [16.0, 32.0]
            ),
        ),
    ),
    Line(
        "six-export",
        "control design",
        Fact(
            "gains and poles are held",
            lambda runs: all(
                abs(one["difference_percent"]) < 0.1
                for one in runs["six-export"].document["quantities"]
                if "delay" not in one["name"]
            ),
        ),
        Fact(
            "delays are held",
            lambda runs: all(
                one["held"] != "not" for one in runs["six-export"].document["quantities"] if "delay" in one["name"]
            ),
        ),
    ),
    Line(
        "s500-joined",
        "a log for each axis",
        Number("logs", lambda runs: len(runs["s500-joined"].document["provenance"]["inputs"]), paper=2, within=0),
        *table("s500-joined", TABLE_7),
    ),
    Line(
        "as-published",
        "u̇, v̇, ẇ",
        has_kind("as-published", "reconstructed"),
        *table("as-published", ("Z_thrust",)),
    ),
    Line(
        "as-published",
        "chirp-z transform",
        Fact(
            "windows of table 2",
            lambda runs: (
                runs["as-published"].document["provenance"]["settings"]["input_windows_s"]
                == ["pitch_command:9.0,8.0,7.0,6.0,5.0", "thrust_command:8.9,7.6,6.4,5.1,3.8"]
            ),
        ),
    ),
    Line("as-published", "bands by coherence", *bands("as-published", TABLE_3, LOWEST_3)),
    Line(
        "as-published",
        "eqs 4, 5",
        has_kind("as-published", "speed_damping_first"),
        first_damping("as-published", "X_u"),
        first_damping("as-published-lateral", "Y_v"),
        *table("as-published", TABLE_4, "X_u"),
    ),
    Line(
        "as-published-lateral",
        "table 6",
        *bands("as-published-lateral", TABLE_6),
        *table("as-published-lateral", TABLE_7, "Y_v", "tau_roll"),
        Number(
            "tau_roll [s]", parameter("as-published-lateral", "tau_roll"), truth=truth("s500", "tau_roll"), paper=0.041
        ),
    ),
    Line("s500-response", "fig 3", drawn("s500-response", "timeline-0", "Time", panels=2, curves=2, bands=1)),
    Line(
        "s500-response",
        "five windows",
        Number("windows", lambda runs: len(runs["s500-response"].document["windows_s"]), paper=5, within=0),
        Fact(
            "each has its share of some response",
            lambda runs: np.all(np.nanmax(runs["s500-response"].arrays()["window_share"], axis=(0, 1, 3)) > 0.05),
        ),
        Fact("the figure shows them", lambda runs: len(runs["s500-response"].figure("windows-0")[0]["lines"]) == 5),
    ),
    Line(
        "s500-response",
        "correlated inputs",
        Number(
            "coherence of pitch and thrust command",
            lambda runs: runs["s500-response"].document["input_coherence"]["pitch_command,thrust_command"],
            most=0.8,
        ),
        *(
            Number(
                f"{output} over truth, in its errors",
                of(long_misfit, output, input),
                most=2.0,
            )
            for output, input in (("q", "pitch_command"), ("ax", "pitch_command"), ("az", "thrust_command"))
        ),
    ),
    Line(
        "s500-response",
        "coherence of every response",
        *(
            Number(f"{pair}, mean coherence", field("s500-response", "pairs", pair, "mean_coherence"), least=0.6)
            for pair in ("q/pitch_command", "ax/pitch_command", "az/thrust_command")
        ),
        drawn("s500-response", "responses-pitch_command", "coherence", panels=3, curves=3),
    ),
    Line(
        "s500-axes",
        "fig 4",
        *(
            Number(f"{pair}, to [rad/s]", field("s500-axes", "pairs", pair, "band_rad_s", 1), paper=high, least=high)
            for pair, high in (
                ("q/pitch_command", 30.0),
                ("az/thrust_command", 21.0),
                ("p/roll_command", 30.0),
                ("r/yaw_command", 21.0),
            )
        ),
        Fact("four in sight, those across axes folded", four_in_sight),
        drawn("s500-axes", "responses-roll_command", "measured", panels=3, curves=3, bands=2),
    ),
    Line(
        "s500-cut",
        "sweep limits",
        Number("from [s]", field("s500-cut", "records", 0, "start_s"), paper=34.0, within=0.01),
        Number("to [s]", field("s500-cut", "records", 0, "stop_s"), paper=94.0, within=0.01),
    ),
    Line(
        "s500-sensors",
        "sensor scale",
        has_kind("s500-sensors", "sensor_corrected"),
        has_kind("s500-sensors", "sensor_not_corrected"),
        Number(
            "change of the gain of roll",
            corrected,
            truth=0.0,
            within=0.02,
            because="sensors of the simulation are perfect",
        ),
    ),
    Line(
        "s500-unfiltered",
        "known filters, removed",
        Number(
            "delay that was removed [s]",
            field("s500-unfiltered", "filters_removed", "q", "delay_s"),
            truth=2.0**0.5 / (2.0 * 3.14159265 * 60.0),
            within=1e-4,
        ),
        has_kind("s500-unfiltered", "known_filter"),
    ),
    Line(
        "s500-transfer",
        "transfer functions",
        Number("gain at 20 rad/s over the true one", long_gain, truth=1.0, within=0.05, because="random error"),
        Number("delay left at 20 rad/s [s]", lateness, truth=0.0, within=0.002),
        Number("cost", field("s500-transfer", "cost", "average"), most=50.0),
    ),
    Line(
        "s500-search",
        "search from own starts",
        *table("s500-search", ("M_u", "M_pitch", "Z_thrust", "X_u")),
        Number("starts", field("s500-search", "search", "local_searches"), paper=8, within=1),
    ),
    Line(
        "rotorid vehicles s500 --toml",
        "fig 2",
        printed("rotorid vehicles s500 --toml", "mass_kg = 1.4", "inertia_kg_m2 = [0.0155, 0.0165, 0.029]"),
    ),
    Line(
        "rotorid inspect s500/flight.ulg --json",
        "drift, bias",
        *(
            Number(f"scale of {name} against attitude", of(kinematic, name, "scale"), truth=1.0)
            for name in ("p", "q", "r")
        ),
        *(Number(f"bias of {name} [rad/s]", of(kinematic, name, "bias"), truth=0.0) for name in ("p", "q", "r")),
        Number(
            "skew of p between two topics [s]",
            lambda runs: inspected(runs)["skews"][0]["seconds"],
            truth=0.002,
            within=1e-4,
            because="its known filter",
        ),
    ),
    Line(
        "rotorid inspect s500/flight.ulg --json",
        "table 1",
        Fact(
            "sweeps on four inputs are found",
            lambda runs: (
                {one["axis"] for one in inspected(runs)["excitations"] if one["kind"] == "sweep"}
                == {"roll", "pitch", "yaw", "thrust"}
            ),
        ),
        Number(
            "length of the roll sweep [s]",
            lambda runs: next(
                one["stop_s"] - one["start_s"] for one in inspected(runs)["excitations"] if one["axis"] == "roll"
            ),
            truth=60.0,
            within=1.0,
        ),
        Fact(
            "inputs come from the mixer",
            lambda runs: any(
                one["name"] == "roll_command" and "torque_setpoint" in one["source"]
                for one in inspected(runs)["channels"]
            ),
        ),
    ),
    Line(
        "rotorid models hover.longitudinal",
        "eq 2",
        printed(
            "rotorid models hover.longitudinal",
            "M_q*q + M_u*u + M_w*w + M_pitch",
            "X_u*u",
            "Z_w*w",
            "theta' = cos(phi0)*q",
        ),
    ),
    Line(
        "rotorid models hover.lateral",
        "eq 3",
        printed("rotorid models hover.lateral", "L_p*p + L_r*r + L_v*v", "N_p*p + N_r*r + N_v*v", "Y_v*v", "phi' = p"),
    ),
)
