"""Paper 1, a rig on a pivot: what proves each line. Print: table of J_X and K_f, G, delays, errors."""

from __future__ import annotations

import csv

import numpy as np
from tests.docs.papers_checks import (
    Estimate,
    Fact,
    Line,
    Number,
    drawn,
    field,
    has_kind,
    no_kind,
    of,
    parameter,
    printed,
    truth,
)
from tests.docs.papers_page import Runs

import rotorid
from rotorid.models.library import library_model
from rotorid.spectral.spectra import spectral_matrices
from rotorid.vehicles import rig

WINDOWS_S = (71.0, 60.0, 40.0)


def log_column(runs: Runs, run: str, file: str, start: str) -> np.ndarray:
    """A column of a table that was flown."""
    with (runs[run].folder / file).open(encoding="utf-8", newline="") as text:
        rows = csv.reader(text)
        column = next(index for index, name in enumerate(next(rows)) if name.startswith(start))
        return np.array([float(row[column]) for row in rows])


def in_band(runs: Runs, which: int) -> float:
    """Share of the power of a planned sweep that lies in the band that was asked for."""
    signal = runs["sweep"].json("plan.json")["inputs"][which]
    power = abs(np.fft.rfft(signal["values"])) ** 2
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(signal["values"]), 1.0 / signal["sample_rate_hz"])
    return float(power[(omega >= 0.5 * 0.6) & (omega <= 1.2 * 12.0)].sum() / power.sum())


def ratio(runs: Runs) -> Estimate:
    """L K_f/J_x of the identified model, as its input matrix has it."""
    K_f = runs["rig-roll"].document["parameters"]["K_f"]
    return Estimate(0.197 * K_f["value"] / 0.047, 0.197 * K_f["std"] / 0.047)


def true_ratio(runs: Runs) -> float:
    L, K_f, J_x = (truth("rig", name)(runs) for name in ("L", "K_f", "J_x"))
    return L * K_f / J_x


def misfit(runs: Runs, run: str, which: str) -> float:
    """Root mean square of a response over the true one, in its own errors, which real and imaginary part have each."""
    file = runs[run].arrays()
    inputs, used = [str(name) for name in file["inputs"]], file["used" if "used" in file else "fitted"][0]
    true = library_model("rig.roll").matrices(
        {name: truth("rig", name)(runs) for name in ("J_x", "K_f", "L", "tau_3", "tau_4")}
    )
    exact = true.response(file["omega_rad_s"])[0][: len(inputs)]
    off = abs(file[which][0] / exact - 1.0)
    return float(np.sqrt(0.5 * np.mean((off[used] / file["random_error"][0][used]) ** 2)))


def independent_sweeps(runs: Runs) -> bool:
    """Whether the two motors are swept each in its own way."""
    first, second = runs["sweep"].json("plan.json")["inputs"]
    alike = abs(np.corrcoef(first["values"], second["values"])[0, 1])
    return {first["motor"], second["motor"]} == {"motor_3", "motor_4"} and bool(alike < 0.5)


def expected_gain(runs: Runs) -> Estimate:
    one = runs["sweep"].document["expected"]["K_f"]
    return Estimate(one["value"], one["std"])


def rate_over_angle(runs: Runs) -> float:
    """Cross spectrum of roll angle and rate over j omega times the auto spectrum of the angle: kinematics say one."""
    record = rotorid.read(runs["rig"].folder / "flight.csv")
    history = rotorid.resample(
        record, channels=("phi", "p"), start_s=0.0, stop_s=119.9, sample_rate_hz=100.0
    ).histories[0]
    (matrix,), _ = spectral_matrices([history], np.linspace(0.5, 5.0, 40), windows_s=[40.0])
    return float(np.median((matrix.values[:, 0, 1] / (1j * matrix.omega_rad_s * matrix.values[:, 0, 0])).real))


def composed(runs: Runs) -> bool:
    """Each window has its share at some frequency, and the shares make the whole."""
    lines = runs["rig-response"].figure("windows-0")[0]["lines"]
    return len(lines) == 3 and all(line["y"][1] > 5.0 for line in lines)


LINES = (
    Line(
        "rig",
        "the experiment",
        Number(
            "record [s]",
            lambda runs: log_column(runs, "rig", "flight.csv", "time")[-1],
            paper=120.0,
            within=0.011,
            because="a sample",
        ),
        Number(
            "sample rate [Hz]",
            lambda runs: float(1.0 / np.median(np.diff(log_column(runs, "rig", "flight.csv", "time")))),
            paper=100.0,
            within=0.01,
        ),
        Number("J_x flown [kg m²]", truth("rig", "J_x"), paper=0.047, within=1e-9),
        Number("K_f flown [N/V]", truth("rig", "K_f"), paper=0.109, within=1e-9),
        Fact(
            "both motors are swept",
            lambda runs: all(
                np.ptp(log_column(runs, "rig", "flight.csv", name)) > 1.0 for name in ("motor_3", "motor_4")
            ),
        ),
    ),
    Line(
        "sweep",
        "band-limited sweeps of two motors",
        *(Number(f"power in the band, sweep {one + 1}", of(in_band, one), least=0.95) for one in (0, 1)),
        Number(
            "largest angle [°]",
            lambda runs: float(np.degrees(runs["sweep"].document["reached_rad"])),
            most=10.0,
            because="the limit",
        ),
        Fact("of two motors, not alike", independent_sweeps),
        Number("K_f expected [N/V]", expected_gain, truth=truth("rig", "K_f")),
    ),
    Line(
        "rig-response",
        "windows of 40, 60 and 71 s",
        *(
            Number(
                f"window {place + 1} [s]",
                field("rig-response", "windows_s", place),
                paper=asked,
                within=0.5,
            )
            for place, asked in enumerate(WINDOWS_S)
        ),
        Fact("each window has its share", composed),
    ),
    Line(
        "rig-response",
        "auto and cross spectra",
        Number("response over truth, in its errors", lambda runs: misfit(runs, "rig-response", "values"), most=1.5),
        Number(
            "cross over auto spectrum of angle and rate",
            rate_over_angle,
            truth=1.0,
            within=0.05,
            because="noise of the angle of 5 %",
        ),
    ),
    Line(
        "rig-response",
        "coherence, random error",
        *(
            Number(
                f"mean coherence, {name}", field("rig-response", "pairs", f"phi/{name}", "mean_coherence"), least=0.6
            )
            for name in ("motor_3", "motor_4")
        ),
        Number(
            "response over truth, in its errors",
            lambda runs: misfit(runs, "rig-response", "values"),
            least=0.5,
            most=1.5,
        ),
    ),
    Line(
        "rig-response",
        "figure of the composite response",
        drawn(
            "rig-response",
            "responses-motor_3",
            "measured",
            "± 2 σ",
            "magnitude",
            "phase",
            "coherence",
            panels=3,
            curves=3,
            bands=2,
        ),
        Number(
            "band, high over low",
            lambda runs: float(np.divide(*runs["rig-response"].document["pairs"]["phi/motor_3"]["band_rad_s"][::-1])),
            least=10.0,
            because="a decade",
        ),
        Fact(
            "the table has both responses",
            lambda runs: (
                {row["response"] for row in runs["rig-response"].table("responses")} >= {"phi/motor_3", "phi/motor_4"}
            ),
        ),
    ),
    Line(
        "rig-default",
        "rule for window lengths",
        Number(
            "longest window over the record",
            lambda runs: max(runs["rig-default"].document["windows_s"]) / 119.93,
            paper=0.2,
            most=0.2,
        ),
        Number(
            "shortest window in periods of 12 rad/s",
            lambda runs: min(runs["rig-default"].document["windows_s"]) * 12.0 / (2.0 * np.pi),
            least=19.9,
            because="Tischler and Remple",
        ),
    ),
    Line(
        "rig-coherent",
        "points with a coherence of 0.6",
        Number(
            "least coherence of points in use",
            lambda runs: min(
                value
                for pair in runs["rig-coherent"].document["pairs"].values()
                for value, used in zip(pair["coherence"], pair["used"], strict=True)
                if used
            ),
            paper=0.6,
            least=0.6,
        ),
        Fact(
            "fewer points than by default",
            lambda runs: (
                runs["rig-coherent"].document["pairs"]["phi/motor_3"]["points"]
                < runs["rig-default"].document["pairs"]["phi/motor_3"]["points"]
            ),
        ),
    ),
    Line(
        "rig-roll",
        "response of a state space",
        Number("model over truth, in errors of the response", lambda runs: misfit(runs, "rig-roll", "model"), most=1.0),
    ),
    Line(
        "rig-roll",
        "cost by response",
        Number("average cost", field("rig-roll", "cost", "average"), paper=85.3, most=100.0),
        *(
            Number(f"cost of {name}", field("rig-roll", "cost", "pairs", f"phi/{name}", "value"), most=100.0)
            for name in ("motor_3", "motor_4")
        ),
        Fact(
            "the average is that of the responses",
            lambda runs: np.isclose(
                runs["rig-roll"].document["cost"]["average"],
                np.mean([pair["value"] for pair in runs["rig-roll"].document["cost"]["pairs"].values()]),
            ),
        ),
    ),
    Line(
        "rig-roll",
        "K-means, candidates",
        Number(
            "candidates",
            lambda runs: len(runs["rig-roll"].document["search"]["iterations"][0]["clusters"]),
            paper=3,
            within=0,
        ),
        Fact(
            "every point belongs to a candidate",
            lambda runs: all(
                len(step["owners"]) == len(runs["rig-roll"].document["search"]["points"])
                and sum(one["points"] for one in step["clusters"]) == len(step["owners"])
                for step in runs["rig-roll"].document["search"]["iterations"]
            ),
        ),
        drawn("rig-roll", "search-cost-clusters", panels=1, curves=1),
    ),
    Line(
        "rig-roll",
        "first candidates",
        Fact(
            "the trace falls to the minimum",
            lambda runs: (
                runs["rig-roll"].document["search"]["trace"][-1][1]
                <= 1.001 * runs["rig-roll"].document["search"]["minima"][0]["cost"]
                < runs["rig-roll"].document["search"]["trace"][0][1]
            ),
        ),
        Number(
            "K_f of the lowest minimum [N/V]",
            field("rig-roll", "search", "minima", 0, "parameters", "K_f"),
            truth=truth("rig", "K_f"),
            within=0.0022,
            because="2 %",
        ),
        drawn("rig-roll", "search-cost", curves=1),
    ),
    Line(
        "rig-roll",
        "G and the two delays",
        Number("L K_f/J_x [rad/s² V]", ratio, truth=true_ratio, paper=0.458),
        Number("L K_f/J_x [rad/s² V], within 2 %", ratio, truth=true_ratio, paper=0.458, within=0.0091, because="2 %"),
        Number("tau_3 [s]", parameter("rig-roll", "tau_3"), truth=truth("rig", "tau_3"), paper=0.2279),
        Number("tau_4 [s]", parameter("rig-roll", "tau_4"), truth=truth("rig", "tau_4"), paper=0.1770),
        Fact(
            "tables hold the same",
            lambda runs: (
                np.isclose(float(runs["rig-roll"].table("matrix_G")[1]["motor_3"]), ratio(runs).value)
                and np.isclose(
                    1e-3 * float(runs["rig-roll"].table("delays")[0]["total_ms"]),
                    runs["rig-roll"].document["parameters"]["tau_3"]["value"],
                )
            ),
        ),
    ),
    Line(
        "rig-roll",
        "table of J_X, K_f, cost",
        Number("K_f [N/V]", parameter("rig-roll", "K_f"), truth=truth("rig", "K_f"), paper=0.109),
        Number(
            "error of K_f [%]",
            lambda runs: 100.0 * abs(parameter("rig-roll", "K_f")(runs).value / truth("rig", "K_f")(runs) - 1.0),
            paper=8.2,
            most=8.2,
        ),
        Fact(
            "the table has them",
            lambda runs: {"J_x", "K_f"} <= {row["parameter"] for row in runs["rig-roll"].table("parameters")},
        ),
    ),
    Line(
        "rig-roll",
        "figure of magnitude and phase",
        *(
            drawn(
                "rig-roll", f"responses-{name}", "measured", "model", "magnitude", "phase", panels=3, curves=4, bands=2
            )
            for name in ("motor_3", "motor_4")
        ),
    ),
    Line(
        "rig-roll",
        "model on an unseen flight",
        *(
            Number(f"cost of {name}, unseen", field("rig-roll", "verification", "frequency", f"phi/{name}"), most=50.0)
            for name in ("motor_3", "motor_4")
        ),
    ),
    Line(
        "rig-both",
        "J and K_f, one must be known",
        has_kind("rig-both", "not_identifiable"),
        Number(
            "K_f/J_x, the only ratio",
            lambda runs: (
                runs["rig-both"].document["parameters"]["K_f"]["value"]
                / runs["rig-both"].document["parameters"]["J_x"]["value"]
            ),
            truth=lambda runs: truth("rig", "K_f")(runs) / truth("rig", "J_x")(runs),
            paper=0.109 / 0.047,
            within=0.05,
            because="2 %",
        ),
        Number(
            "error of J_x, at most 1000 [%]",
            # What the data do not show at all has an error that rounding chooses.
            lambda runs: min(
                100.0 * np.divide(*[runs["rig-both"].document["parameters"]["J_x"][key] for key in ("std", "value")]),
                1000.0,
            ),
            least=100.0,
        ),
    ),
    Line(
        "rig-stopped",
        "stop at an average cost of 100",
        Number(
            "average cost where it stopped",
            lambda runs: runs["rig-stopped"].document["search"]["alone"]["cost"] / 2.0,
            paper=100.0,
            most=100.0,
        ),
        Fact(
            "earlier than without",
            lambda runs: (
                runs["rig-stopped"].document["search"]["evaluations"]
                < runs["rig-roll"].document["search"]["evaluations"]
            ),
        ),
    ),
    Line(
        "rig-five",
        "k from 3 to 5",
        Number(
            "candidates",
            lambda runs: len(runs["rig-five"].document["search"]["iterations"][0]["clusters"]),
            paper=5,
            within=0,
        ),
        Number("K_f [N/V]", parameter("rig-five", "K_f"), truth=truth("rig", "K_f"), paper=0.109),
    ),
    Line(
        "rig-sobol",
        "other searches",
        Number("starts", field("rig-sobol", "search", "evaluations"), paper=16, within=0),
        Number("K_f [N/V]", parameter("rig-sobol", "K_f"), truth=truth("rig", "K_f"), paper=0.109),
    ),
    Line(
        "rig-noise",
        "artificial noise",
        Number(
            "K_f, spread over noise [N/V]", field("rig-noise", "noise_runs", "parameters", "K_f", "std"), most=2.2e-3
        ),
        Fact("noise is added to the log", lambda runs: "--add-noise" in runs["rig-noise"].log["command"]),
    ),
    Line(
        "rig-attitude",
        "roll, pitch and yaw at once",
        Number("J_x [kg m²]", parameter("rig-attitude", "J_x"), truth=rig.ATTITUDE["J_x"], paper=0.047),
        Number("J_y [kg m²]", parameter("rig-attitude", "J_y"), truth=rig.ATTITUDE["J_y"]),
        Number("J_z [kg m²]", parameter("rig-attitude", "J_z"), truth=rig.ATTITUDE["J_z"]),
        Number("tau_1 [s]", parameter("rig-attitude", "tau_1"), truth=rig.ATTITUDE["tau_1"]),
        Number("tau_2 [s]", parameter("rig-attitude", "tau_2"), truth=rig.ATTITUDE["tau_2"]),
        Number("tau_3 [s]", parameter("rig-attitude", "tau_3"), truth=rig.ATTITUDE["tau_3"], paper=0.2279),
        Number("tau_4 [s]", parameter("rig-attitude", "tau_4"), truth=rig.ATTITUDE["tau_4"], paper=0.1770),
        no_kind("rig-attitude", "not_identifiable", "poor_fit"),
    ),
    Line(
        "rotorid models rig.attitude",
        "linear model of the attitude",
        printed(
            "rotorid models rig.attitude",
            "phi' = p",
            "p' = L*K_f/J_x*motor_3 - L*K_f/J_x*motor_4",
            "q' = L*K_f/J_y*motor_1 - L*K_f/J_y*motor_2",
            "r' = -K_t/J_z*motor_1 - K_t/J_z*motor_2 + K_t/J_z*motor_3 + K_t/J_z*motor_4",
        ),
    ),
    Line(
        "rotorid models rig.roll",
        "roll alone",
        printed(
            "rotorid models rig.roll",
            "p' = L*K_f/J_x*motor_3 - L*K_f/J_x*motor_4",
            'motor_3 = "tau_3"',
            'motor_4 = "tau_4"',
        ),
    ),
)
