"""Paper 5, a Bebop behind its set-points: what proves each line. Print: tables I to VI, appendix L."""

from __future__ import annotations

import math
from collections.abc import Callable
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
    no_kind,
    of,
    parameter,
    printed,
)
from tests.docs.papers_page import Runs

from rotorid.vehicles import bebop

INSIDE_1_S = bebop.CLIMB_1_S + bebop.CLIMB_DRAG_1_S
LATE_S = bebop.CLIMB_DELAY_S + bebop.LAG_S
GAINS = {"phi": 1.0, "theta": 1.0, "velocity_down": bebop.CLIMB_1_S * bebop.CLIMB_GAIN / INSIDE_1_S}
DELAYS_S = {
    "phi": 1.0 / bebop.ANGLE_1_S[0],
    "theta": 1.0 / bebop.ANGLE_1_S[1],
    "velocity_down": LATE_S + (1.0 - bebop.CLIMB_1_S * LATE_S) / INSIDE_1_S,
}
"""Steady gain of each answer and its delay in the mean, whatever the loops inside do."""
CHANNELS = tuple(GAINS)
RISE = (
    "rotorid.signal.rise_time_bandwidth("
    'rotorid.signal.step_responses(history, command="theta_setpoint", response="theta"))'
)
CROSS = (
    'rotorid.signal.cross_terms(history, output="theta", own="theta_setpoint", '
    'others=["phi_setpoint", "velocity_down_setpoint"])'
)
THRUST = (
    "rotorid.signal.thrust_limit(rotorid.signal.thrust_over_weight(history, cutoff_rad_s=12.0), sample_rate_hz=20.0)"
)
TABLE_II = {"first": 73.4, "first-delay": 76.7, "second": 82.9, "third": 83.5}


def mean_delay(run: str, channel: str) -> Callable[[Runs], Estimate]:
    """Lag and dead time of an answer together, with the deviation of their sum."""

    def found(runs: Runs) -> Estimate:
        document = runs[run].document
        values = {name: one["value"] for name, one in document["parameters"].items()}
        if f"omega_{channel}" in values:
            omega, zeta = values[f"omega_{channel}"], values[f"zeta_{channel}"]
            slopes = {f"omega_{channel}": -2.0 * zeta / omega**2, f"zeta_{channel}": 2.0 / omega, f"tau_{channel}": 1.0}
            total = 2.0 * zeta / omega + values[f"tau_{channel}"]
        else:
            slopes = {f"T_{channel}": 1.0, f"tau_{channel}": 1.0}
            total = values[f"T_{channel}"] + values.get(f"tau_{channel}", 0.0)
        names = [name for name in slopes if name in document["correlation"]["names"]]
        rows = [document["correlation"]["names"].index(name) for name in names]
        scaled = np.array([slopes[name] * document["parameters"][name]["std"] for name in names])
        variance = scaled @ np.array(document["correlation"]["matrix"])[np.ix_(rows, rows)] @ scaled
        return Estimate(float(total), float(np.sqrt(variance)))

    return found


def answers(run: str) -> tuple[Number, ...]:
    """Steady gains and mean delays of all channels."""
    gains = (Number(f"{run}: K_{name}", parameter(run, f"K_{name}"), truth=GAINS[name]) for name in CHANNELS)
    delays = (
        Number(f"{run}: delay and lag of {name} [s]", mean_delay(run, name), truth=DELAYS_S[name]) for name in CHANNELS
    )
    return (*gains, *delays)


def unseen(run: str) -> Number:
    """Score of the best record on the others: what table II has of other flights of another vehicle."""
    return Number(
        f"{run}: best record on the others [%]",
        field(run, "cross_validation", "best", "mean_percent"),
        paper=TABLE_II[run],
        least=TABLE_II[run],
    )


def explained(run: str, least: float) -> tuple[Number, ...]:
    return tuple(
        Number(f"{run}: {name} explained [%]", field(run, "fit_percent", name), least=least) for name in CHANNELS
    )


def folds(runs: Runs) -> bool:
    """Each record identified once and scored on the three others; the best is the highest mean."""
    crossed = runs["first-delay"].document["cross_validation"]
    means = {one["identified"][0]: one["mean_percent"] for one in crossed["folds"]}
    alone = all(
        len(one["identified"]) == 1 and len(one["unseen"]) == 3 and one["identified"][0] not in one["unseen"]
        for one in crossed["folds"]
    )
    return alone and len(means) == 4 and max(means, key=lambda name: means[name]) == crossed["best"]["record"]


def observable(runs: Runs) -> float:
    """Rank of the observability matrix."""
    matrices = runs["bebop-six"].document["matrices"]
    F, H = np.array(matrices["F"]), np.array(matrices["H0"])
    # Time is scaled by the fastest mode, so that powers stay comparable.
    F = F / max(abs(np.linalg.eigvals(F)))
    return float(
        np.linalg.matrix_rank(np.vstack([H @ np.linalg.matrix_power(F, power) for power in range(6)]), tol=1e-9)
    )


def planned_switches(runs: Runs) -> bool:
    """Three signals of two values each that differ from each other."""
    inputs = runs["bebop-plan"].json("plan.json")["inputs"]
    values = [np.array(one["values"]) for one in inputs]
    two = all(np.isin(np.round(abs(one[one != 0.0]), 6), np.round([abs(one).max()], 6)).mean() > 0.95 for one in values)
    alike = [abs(np.corrcoef(values[i], values[j])[0, 1]) for i, j in ((0, 1), (0, 2), (1, 2))]
    return len(values) == 3 and two and max(alike) < 0.5


def steady(runs: Runs, name: str) -> Estimate:
    """Drag of the two records: mean, and spread as in table I."""
    each = [one["parameters"][name]["value"] for one in runs["bebop-drag"].document["records"]]
    return Estimate(float(np.mean(each)), float(np.std(each, ddof=1)))


def rms(runs: Runs, output: str) -> float:
    return float(next(row for row in runs["bebop-flown"].table("flown") if row["output"] == output)["rms"])


def flown_percent(runs: Runs, output: str) -> float:
    return float(next(row for row in runs["bebop-flown"].table("flown") if row["output"] == output)["fit_percent"])


def rise(runs: Runs) -> float:
    found = runs.python(RISE)
    return float(found.bandwidth_hz * found.rise_s)


def headed(runs: Runs) -> float:
    """Speed over ground before and after the turn to the heading: it stays the same."""
    turned, history = runs.python("rotorid.signal.to_heading(history)"), runs.given["history"]
    before = np.hypot(history["velocity_north"], history["velocity_east"])
    after = np.hypot(turned["velocity_forward"], turned["velocity_right"])
    return float(abs(after - before).max())


def integrators(runs: Runs) -> float:
    """Largest difference of two integrators in position."""
    from rotorid.simulation import simulate_nonlinear

    whole, still, asked = (runs.given[name] for name in ("whole", "still", "asked"))
    one = runs.python('simulate_adaptive(whole, still.values, asked, sample_rate_hz=20.0, method="lsoda")')
    other = simulate_nonlinear(whole, still.values, asked, sample_rate_hz=20.0)
    return float(abs(np.asarray(one)[:3] - np.asarray(other)[:3]).max())


def score(runs: Runs, result: str, column: str) -> float:
    """A cell of the table of models."""
    return float(next(row for row in runs["bebop-compared"].table("models") if row["result"] == result)[column])


def best(runs: Runs, result: str) -> float:
    return float(runs[result].document["cross_validation"]["best"]["mean_percent"])


def rate_delay(runs: Runs, place: int) -> Estimate:
    one = runs["bebop-rates"].document["rates"][place]
    return Estimate(one["delay_s"], one["std_s"])


def dead_time(runs: Runs, channel: str) -> float:
    return float(runs["bebop-delay"].document["pairs"][f"{channel}/{channel}_setpoint"]["recommended"]["delay_s"])


def tilted(runs: Runs) -> float:
    """Acceleration to the north of a vehicle that is tilted up by 0.1 rad, from the first moments of a flight."""
    from rotorid.simulation import simulate_nonlinear

    whole, still = runs.given["whole"], runs.given["still"]
    asked = np.zeros((4, 200))
    asked[1] = 0.1
    path = simulate_nonlinear(
        whole, {**still.values, "k_Dx": 0.0, "k_Dy": 0.0, "K_theta": 1.0}, asked, sample_rate_hz=20.0
    )
    north = path[list(whole.outputs).index("velocity_north")]
    return float((north[-1] - north[-41]) / 2.0)


def lag(runs: Runs) -> float:
    """Samples by which the low-passed angle is late."""
    smooth = runs.python("rotorid.signal.low_pass(history, cutoff_rad_s=2 * np.pi * 5.0)")["theta"]
    theta, slope = runs.given["history"]["theta"], np.gradient(runs.given["history"]["theta"])
    return float(-np.dot(smooth - theta, slope) / np.dot(slope, slope))


def true_rise_s() -> float:
    """From 10 to 90 % of the vehicle's own answer to a step of the pitch set-point."""
    step_s = 1e-4
    held, late, motor, rate, angle = round(bebop.TILT_DELAY_S / step_s), [], 0.0, 0.0, 0.0
    path = []
    for _ in range(20_000):
        late.append(bebop.RATE_1_S[1] * (bebop.ANGLE_1_S[1] * (1.0 - angle) - rate))
        wanted = late[-held - 1] if len(late) > held else 0.0
        motor += step_s * (wanted - motor) / bebop.LAG_S
        rate += step_s * motor
        angle += step_s * rate
        path.append(angle)
    reached = np.array(path)
    return step_s * float(np.argmax(reached > 0.9) - np.argmax(reached > 0.1))


def risen(runs: Runs) -> Estimate:
    found = runs.python(RISE)
    return Estimate(found.rise_s, found.rise_std_s)


def independent(runs: Runs) -> bool:
    """Whether the other inputs add less than a thousandth of the variance, which chance explains."""
    found = runs.python(CROSS)
    return bool(found.added_share < 1e-3 and found.p_shifted > 0.05 and found.own_share > 0.9)


def thrust(runs: Runs) -> Any:
    return runs.python(THRUST)


LINES = (
    Line(
        "bebop-plan",
        "random binary signals on three axes",
        Fact("three of two values, not alike", planned_switches),
        Number(
            "upper end, pitch [Hz]",
            lambda runs: runs["bebop-plan"].json("plan.json")["inputs"][1]["band_rad_s"][1] / (2.0 * math.pi),
            paper=1.35,
            within=0.28,
            because="table IV",
        ),
        Number(
            "rate of commands [Hz]",
            lambda runs: runs["bebop-plan"].json("plan.json")["inputs"][1]["settings"]["clock_hz"],
            paper=20.0,
            within=1e-9,
        ),
    ),
    Line(
        "bebop-figures",
        "eqs 7, 12 to 14",
        Fact(
            "each set-point moves its own answer alone",
            lambda runs: (
                set(runs["bebop-figures"].document["cost"]["pairs"])
                == {"phi/phi_setpoint", "theta/theta_setpoint", "velocity_down/velocity_down_setpoint"}
            ),
        ),
        *answers("bebop-figures"),
    ),
    Line(
        "bebop-figures",
        "simulation with measured inputs",
        *explained("bebop-figures", 82.9),
        Number(
            "theta, unseen [%]",
            lambda runs: runs["bebop-figures"].document["verification"]["maneuvers"][0]["scores"]["theta"][
                "nrmse_fit_percent"
            ],
            paper=82.9,
            least=82.9,
        ),
    ),
    Line(
        "bebop-figures",
        "printed models",
        Fact(
            "F is made of the parameters",
            lambda runs: np.isclose(
                runs["bebop-figures"].document["matrices"]["F"][1][0],
                -(runs["bebop-figures"].document["parameters"]["omega_phi"]["value"] ** 2),
            ),
        ),
        Fact(
            "both tables are LaTeX",
            lambda runs: all(
                "tabular" in runs["bebop-figures"].text(f"tables/{name}.tex") for name in ("matrix_F", "parameters")
            ),
        ),
    ),
    Line(
        "bebop-figures",
        "figs 4 to 6",
        drawn("bebop-figures", "time-0", "measured", panels=3, curves=6),
        drawn("bebop-figures", "check-0", "measured", panels=3, curves=6),
    ),
    Line(
        "bebop-figures",
        "appendix A",
        Number("K_velocity_down", parameter("bebop-figures", "K_velocity_down"), truth=GAINS["velocity_down"]),
    ),
    Line(
        "bebop-figures",
        "appendix K, fig 19",
        Number(
            "reference shift of theta, unseen [rad]",
            lambda runs: runs["bebop-figures"].document["verification"]["maneuvers"][0]["scores"]["theta"][
                "reference_shift"
            ],
            truth=0.0,
            within=0.005,
            because="noise of the attitude",
        ),
        Fact(
            "a filter finds states too",
            lambda runs: (
                runs.python("__import__('rotorid.simulation', fromlist=['kalman_start']).kalman_start") is not None
            ),
        ),
    ),
    Line(
        "bebop-figures",
        "errors of the parameters",
        Fact(
            "they include the color of the residuals",
            lambda runs: (
                runs["bebop-figures"].document["residuals"]["inflation"] > 1.0
                and all(
                    one["std"] >= one["std_random"] > 0.0
                    for one in runs["bebop-figures"].document["parameters"].values()
                )
            ),
        ),
        Fact("the table has them", lambda runs: "Std" in runs["bebop-figures"].text("tables/parameters.tex")),
    ),
    Line(
        "bebop-together",
        "more records in one fit",
        Number("records", lambda runs: len(runs["bebop-together"].document["records"]), paper=4, within=0),
        *answers("bebop-together"),
    ),
    Line(
        "bebop-cut",
        "takeoff and landing",
        Number(
            "from [s]",
            lambda runs: runs["bebop-cut"].document["provenance"]["maneuvers"][0]["start_s"],
            paper=5.0,
            within=0.06,
            because="a sample",
        ),
        Number(
            "to [s]",
            lambda runs: runs["bebop-cut"].document["provenance"]["maneuvers"][0]["stop_s"],
            paper=30.0,
            within=0.06,
            because="a sample",
        ),
        Number("theta explained [%]", field("bebop-cut", "fit_percent", "theta"), least=76.7, paper=76.7),
    ),
    Line(
        "yaw-rate",
        "appendix J",
        Number("K_r", parameter("yaw-rate", "K_r"), truth=1.0, because="the rate loop integrates"),
        Number("r explained [%]", field("yaw-rate", "fit_percent", "r"), least=50.0),
        no_kind("yaw-rate", "poor_fit"),
    ),
    Line(
        "first",
        "eq 15",
        *(Number(f"K_{name}", parameter("first", f"K_{name}"), truth=GAINS[name]) for name in CHANNELS),
        unseen("first"),
    ),
    Line(
        "first-delay",
        "eq 16",
        *(
            Number(f"delay and lag of {name} [s]", mean_delay("first-delay", name), truth=DELAYS_S[name])
            for name in CHANNELS
        ),
        unseen("first-delay"),
    ),
    Line("first-delay", "fig 3", Fact("each record once, the best by its mean", folds)),
    Line(
        "second",
        "eq 17, second order",
        unseen("second"),
        *(Number(f"K_{name}", parameter("second", f"K_{name}"), truth=GAINS[name]) for name in CHANNELS),
        Number("states", lambda runs: len(runs["second"].document["matrices"]["F"]), paper=6, within=0),
    ),
    Line("second-delay", "eq 18", *answers("second-delay")),
    Line(
        "third",
        "eq 17, third",
        unseen("third"),
        Number("states", lambda runs: len(runs["third"].document["matrices"]["F"]), paper=9, within=0),
        Fact("all poles are stable", lambda runs: all(one["real"] < 0.0 for one in runs["third"].document["poles"])),
    ),
    Line(
        "bebop-six",
        "appendix K, observability",
        Number("rank of observability", observable, paper=6, within=0),
        no_kind("bebop-six", "order_too_high"),
    ),
    Line(
        "bebop-order",
        "order by cross-validation",
        Fact(
            "the order scores as the best one does, within its error",
            lambda runs: (
                next(
                    row
                    for row in runs["bebop-order"].document["orders"]["rows"]
                    if row["order"] == runs["bebop-order"].document["orders"]["order"]
                )["unseen_percent"]
                >= max(row["unseen_percent"] for row in runs["bebop-order"].document["orders"]["rows"]) - 1.0
            ),
        ),
        Number("order", lambda runs: runs["bebop-order"].document["orders"]["order"], paper=3, least=2, most=4),
    ),
    Line(
        "bebop-compared",
        "tables II, VI",
        *(
            Number(
                f"{row}, on a log [%]",
                of(score, row, "on_logs_percent"),
                paper=TABLE_II[row],
                least=TABLE_II[row],
            )
            for row in ("first-delay", "second", "third")
        ),
        Fact(
            "higher orders have more parameters and a lower criterion",
            lambda runs: (
                score(runs, "third", "free_parameters")
                > score(runs, "second", "free_parameters")
                > score(runs, "first-delay", "free_parameters")
                and score(runs, "third", "aic") < score(runs, "first-delay", "aic")
            ),
        ),
    ),
    Line(
        "bebop-steps",
        "appendix C, fig 11",
        Number(
            "gain by the delay [%]", lambda runs: best(runs, "first-delay") - best(runs, "first"), paper=5.0, least=1.0
        ),
        Fact(
            "steps of both models are drawn together",
            lambda runs: "Step responses of the models" in runs["bebop-steps"].text("figures/captions.txt"),
        ),
    ),
    Line(
        "bebop-drag",
        "table I",
        Number("k_Dx [1/s]", parameter("bebop-drag", "k_Dx"), truth=0.25, paper=0.25),
        Number("k_Dy [1/s]", parameter("bebop-drag", "k_Dy"), truth=0.33, paper=0.33),
        *(
            Number(
                f"{name}, mean of records [1/s]",
                of(steady, name),
                truth=value,
                paper=value,
                within=spread,
                because="table I",
            )
            for name, value, spread in (("k_Dx", 0.25, 0.08), ("k_Dy", 0.33, 0.05))
        ),
        Fact(
            "in steady tilts",
            lambda runs: all(
                one["shape"] == "doublet" and one["stop_s"] - one["start_s"] >= 8.0
                for one in runs["bebop-tilts"].json("plan.json")["inputs"]
            ),
        ),
    ),
    Line(
        "bebop-drag2",
        "quadratic drag",
        Number(
            "k_Dx |u|, at 0.45 m/s [1/s]",
            lambda runs: 0.45 * parameter("bebop-drag2", "k_Dx")(runs).value,
            truth=0.25,
            within=0.08,
            because="one speed of a linear drag",
        ),
        Fact("two coefficients", lambda runs: set(runs["bebop-drag2"].document["parameters"]) == {"k_Dx", "k_Dy"}),
    ),
    Line(
        "bebop-flight",
        "eqs 9 to 11",
        Number("k_Dx [1/s]", parameter("bebop-flight", "k_Dx"), truth=0.25, paper=0.25),
        Number("k_Dy [1/s]", parameter("bebop-flight", "k_Dy"), truth=0.33, paper=0.33),
        *(
            Number(f"K_{name}", parameter("bebop-flight", f"K_{name}"), truth=gain)
            for name, gain in (("phi", 1.0), ("theta", 1.0), ("down", GAINS["velocity_down"]))
        ),
        Fact(
            "yaw was not flown and stays fixed",
            lambda runs: runs["bebop-flight"].document["parameters"]["K_psi"]["status"] == "fixed",
        ),
    ),
    Line(
        "bebop-flown",
        "figs 7 to 9",
        *(
            Number(f"{name} explained [%]", of(flown_percent, name), least=80.0)
            for name in ("velocity_north", "velocity_east", "north", "east")
        ),
        Number(
            "down, off by [m]", lambda runs: rms(runs, "down"), most=0.2, because="a gain of 3 % over 30 s of climbs"
        ),
        drawn("bebop-flown", "flown-0-positions", panels=3, curves=6),
        drawn("bebop-flown", "flown-0-velocities", panels=2, curves=4),
    ),
    Line(
        "bebop-acausal",
        "low-pass of outputs alone",
        has_kind("bebop-acausal", "acausal_output"),
        Fact("and not where there is none", lambda runs: "acausal_output" not in runs["bebop-delay"].kinds),
    ),
    Line(
        "bebop-delay",
        "delay in samples",
        *(
            Number(
                f"{name}, by a lag of second order [s]",
                of(dead_time, name),
                truth=parameter("bebop-figures", f"tau_{name}"),
                within=0.01,
                because="the fit of the same order",
            )
            for name in CHANNELS
        ),
        Fact(
            "an ARX model gives whole samples",
            lambda runs: all(
                float(one["delay_samples"]).is_integer()
                for pair in runs["bebop-delay"].document["pairs"].values()
                for one in pair["others"]
                if one["method"] == "samples"
            ),
        ),
    ),
    Line(
        "bebop-rates",
        "appendix D, fig 12",
        Fact("runs of several rates", lambda runs: len(runs["bebop-rates"].document.get("rates", ())) > 2),
        *(
            Number(
                f"delay at {rate} Hz [s]",
                of(rate_delay, place),
                truth=bebop.FIRST_ORDER_DELAY["tau_theta"] + turns / bebop.LOOP_HZ,
                within=within,
                because=because,
            )
            for place, rate, turns, within, because in (
                (0, 5, 0.5, 0.1, "half a sample"),
                (1, 20, 0.5, 0.025, "half a sample"),
                (2, 50, bebop.BUFFERED, 0.05, "a turn of the loop"),
                (3, 100, bebop.BUFFERED, 0.05, "a turn of the loop"),
            )
        ),
        has_kind("bebop-rates", "buffered_commands"),
        Number(
            "rate up to which commands do not wait [Hz]",
            lambda runs: next(
                one for one in runs["bebop-rates"].document["findings"] if one["kind"] == "buffered_commands"
            )["numbers"]["rate_hz"],
            paper=20.0,
            within=0.1,
            because="stamps",
        ),
    ),
    Line(
        "bebop-central",
        "eq 24",
        Number("starts, 2^4 + 2·4 + 1", field("bebop-central", "search", "evaluations"), paper=25, within=0),
        Number("K_theta", parameter("bebop-central", "K_theta"), truth=1.0),
        Number("delay and lag of theta [s]", mean_delay("bebop-central", "theta"), truth=DELAYS_S["theta"]),
    ),
    Line(
        "bebop-random",
        "appendix H",
        Number("starts", field("bebop-random", "search", "evaluations"), paper=16, within=0),
        Fact(
            "the lowest minimum is that of the plain fit",
            lambda runs: np.isclose(
                runs["bebop-random"].document["log_likelihood"],
                runs["bebop-figures"].document["log_likelihood"],
                rtol=1e-5,
            ),
        ),
    ),
    Line(
        "rotorid models",
        "white, gray and black boxes",
        printed("rotorid models", "physical.hover", "hover.longitudinal", "response.*", "black_box:N"),
    ),
    Line(
        "rotorid inspect bebop/flight_1.csv --json",
        "fig 1, eqs 1, 8",
        printed(
            "rotorid inspect bebop/flight_1.csv --json",
            *(f'"name": "{name}"' for name in ("north", "east", "down", "velocity_north", "phi", "theta", "psi")),
        ),
        Number(
            "rate [Hz]",
            lambda runs: float(
                next(
                    one
                    for one in runs.json_of("rotorid inspect bebop/flight_1.csv --json")["channels"]
                    if one["name"] == "theta"
                )["rate_hz"]
            ),
            paper=20.0,
            within=0.2,
            because="stamps",
        ),
    ),
    Line(
        'nonlinear_model("flight.first_order")',
        "eqs 2 to 6",
        Number(
            "acceleration of a tilt of 0.1 rad [m/s²]",
            tilted,
            truth=-9.80665 * math.tan(0.1),
            within=0.02,
            because="small angles",
        ),
    ),
    Line(
        "rotorid.signal.low_pass(history, cutoff_rad_s=2 * np.pi * 5.0)",
        "low-pass of outputs",
        Number(
            "lag of theta [samples]",
            lag,
            truth=0.0,
            within=0.01,
            because="zero phase",
        ),
    ),
    Line(
        "rotorid.signal.to_heading(history)",
        "velocities along the heading",
        Number("change of speed [m/s]", headed, truth=0.0, within=1e-9),
    ),
    Line(
        RISE,
        "eq 23",
        Number("bandwidth × rise time", rise, paper=0.35, within=0.005),
        Number("rise time of pitch [s]", risen, truth=lambda runs: true_rise_s(), paper=0.26),
    ),
    Line(
        CROSS,
        "appendix E",
        Fact("other inputs add nothing", independent),
    ),
    Line(
        'simulate_adaptive(whole, still.values, asked, sample_rate_hz=20.0, method="lsoda")',
        "appendix I",
        Number("positions apart [m]", integrators, paper=0.01, most=0.01),
    ),
    Line(
        THRUST,
        "appendix M",
        Fact(
            "no limit was reached, as the motors say",
            lambda runs: (
                not thrust(runs).saturated
                and all(one["reached"]["saturated"] == 0.0 for one in runs["bebop"].json("simulation.json")["logs"])
            ),
        ),
        Number(
            "highest thrust over weight",
            lambda runs: float(thrust(runs).highest),
            most=bebop.THRUST_PER_WEIGHT,
            least=1.0,
        ),
    ),
)
