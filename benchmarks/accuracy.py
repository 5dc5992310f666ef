"""How accurate identified responses are, ours and those of tuned peers, on the same noisy flights.

Twenty seeds of 60 s at 50 Hz, white noise of a tenth of each output, held inputs; errors of the frequency response over
0.5 to 20 rad/s, root mean square over all pairs, frequencies and seeds. Models of samples are compared with the truth
as samples show it, ours with the truth itself.

Two kinds of models are compared, and they do not know the same. Those of ``Job.ours`` are fitted as a user of rotorid
would: for the closed loops as grey boxes of the true structure and order, for four states as a black box of the true
order. Peers, and the black box of ours that is called ``TUNED``, know no structure, and count with the setting (order,
horizon, delay) that comes closest to the truth, which nobody knows in a flight: all settings are tried on a few seeds,
the best few of them on all. Run ``python -m benchmarks.accuracy``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from benchmarks.accuracy_peers import INSTALL, Peer, Responses, missing, peers, sampled
from benchmarks.direct_response import direct_response, fit_direct
from rotorid.data import Channel, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.fitting import (
    FrequencyProblem,
    InnovationsProblem,
    StartPlan,
    TimeData,
    TimeProblem,
    fit_black_box,
    fit_frequency,
    fit_output_error,
    fit_prediction_error,
    fit_subspace,
)
from rotorid.models import LinearStructure, StateSpace, response_model
from rotorid.simulation import discretize, simulate_linear
from rotorid.spectral import frequency_response
from rotorid.typing import ComplexArray, FloatArray

SEEDS, SCANNED, KEPT = 20, 2, 2
SAMPLES, RATE_HZ, NOISE = 3000, 50.0, 0.1
WINDOWS_S, LEAST_COHERENCE = (20.0, 10.0, 5.0), 0.3
OMEGA_RAD_S = np.geomspace(0.5, 20.0, 40)
BAR_DB, BAR_DEG = 0.1, 0.5
PROPORTIONAL, INTEGRAL = 0.5, 1.0
SECOND_ORDER = response_model("response.second_order_delay", [("phi_setpoint", "phi")])
GUSTS = 0.1
TRUE = {"K_phi": 0.95, "omega_phi": 7.0, "zeta_phi": 0.5, "tau_phi": 0.047}
FOUR_STATES = StateSpace(
    M=np.eye(4),
    F=np.array([[0.0, 1.0, 0.0, 0.0], [-9.0, -2.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [2.0, 0.0, -36.0, -5.0]]),
    G=np.array([[0.0, 0.5], [9.0, 0.0], [0.0, 0.0], [3.0, 36.0]]),
    H0=np.array([[1.0, 0.0, 0.2, 0.0], [0.0, 0.1, 1.0, 0.0]]),
    H1=np.zeros((2, 4)),
    input_delays_s=np.zeros(2),
    output_delays_s=np.zeros(2),
)


class Flown(NamedTuple):
    """A record, and the test inputs that were flown."""

    record: TimeData
    excitation: FloatArray


class Job(NamedTuple):
    """A truth, its flights, our methods, and what peers are tuned over."""

    name: str
    truth: StateSpace
    fly: Callable[[int], Flown]
    ours: dict[str, Callable[[Flown], ComplexArray]]
    orders: tuple[int, ...]
    delays: tuple[int, ...]
    structure: LinearStructure | None = None


class Errors(NamedTuple):
    """Root mean square errors of a response over pairs, frequencies and seeds."""

    magnitude_db: float
    phase_deg: float
    setting: tuple[int, ...] = ()

    def __str__(self) -> str:
        return f"{self.magnitude_db:.3f} dB, {self.phase_deg:.2f} deg"

    @property
    def size(self) -> float:
        """Both as one: the relative error."""
        return float(np.hypot(self.magnitude_db * np.log(10.0) / 20.0, np.radians(self.phase_deg)))

    @property
    def within_bar(self) -> bool:
        return self.magnitude_db <= BAR_DB and self.phase_deg <= BAR_DEG


def closed_loop(*, gusts: float = 0.0) -> Job:
    """An angle under proportional and integral control, with the noise of its sensor in the loop, and gusts."""
    polished = "prediction error" if gusts else "output error"
    return Job(
        name=f"second order and delay, closed loop{', gusts' if gusts else ''}",
        truth=SECOND_ORDER.matrices(TRUE),
        fly=partial(fly_closed_loop, gusts=gusts),
        ours={
            "rotorid, response alone": partial(second_order, polish=""),
            f"rotorid, then {polished}": partial(second_order, polish=polished),
        },
        orders=(3, 4, 5),
        delays=(0, 2),
        structure=SECOND_ORDER,
    )


def four_states() -> Job:
    """Two inputs and two outputs, flown open loop."""
    return Job(
        name="four states, two inputs, two outputs",
        truth=FOUR_STATES,
        fly=fly_four_states,
        ours={"rotorid, subspace alone": subspace, "rotorid, black box": black_box},
        orders=(4, 5),
        delays=(0,),
    )


def binary(rng: np.random.Generator, rows: int) -> FloatArray:
    return np.repeat(rng.choice([-1.0, 1.0], size=(rows, SAMPLES // 8)), 8, axis=1)


def fly_four_states(seed: int) -> Flown:
    rng = np.random.default_rng(seed)
    u = binary(rng, 2)
    y = simulate_linear(FOUR_STATES, u, sample_rate_hz=RATE_HZ)
    noise = NOISE * y.std(axis=1, keepdims=True) * rng.standard_normal(y.shape)
    return Flown(TimeData(name=f"flight {seed}", inputs=u, outputs=y + noise, sample_rate_hz=RATE_HZ), u)


def fly_closed_loop(seed: int, *, gusts: float) -> Flown:
    """The controller samples as the log does, so that the logged input is the held one.

    Gusts act where the input does, in its unit, with a correlation time of a second.
    """
    rng = np.random.default_rng(seed)
    excitation, system = binary(rng, 1), SECOND_ORDER.matrices(TRUE)
    A, B, C, _ = system.proper()
    step, at_once = (
        discretize(A, B, delays_s=delays_s, step_s=1.0 / RATE_HZ, hold="zero")
        for delays_s in (system.input_delays_s, np.zeros(1))
    )
    size = NOISE * simulate_linear(system, excitation, sample_rate_hz=RATE_HZ).std()
    noise, kept = size * rng.standard_normal(SAMPLES), np.exp(-1.0 / RATE_HZ)
    gust = gusts * lfilter([np.sqrt(1.0 - kept**2)], [1.0, -kept], rng.standard_normal(SAMPLES))
    lag = int(step.lags[0])
    u, y = np.zeros(SAMPLES + lag + 1), np.zeros(SAMPLES)
    state, integral = np.zeros(len(A)), 0.0
    for k in range(SAMPLES):
        y[k] = float(C[0] @ state) + noise[k]
        integral += y[k] / RATE_HZ
        u[k + lag + 1] = excitation[0, k] - PROPORTIONAL * y[k] - INTEGRAL * integral
        pushed = step.taps[0, 0] * u[k] + step.taps[1, 0] * u[k + 1] + at_once.taps[1, 0] * gust[k]
        state = step.transition @ state + pushed
    record = TimeData(
        name=f"flight {seed}", inputs=u[None, lag + 1 :], outputs=y[None], sample_rate_hz=RATE_HZ, before=np.zeros(1)
    )
    return Flown(record, excitation)


def second_order(flown: Flown, *, polish: str) -> ComplexArray:
    """The response with the excitation as its instrument, a fit to it, and from there one to the record."""
    structure, records = SECOND_ORDER, (flown.record,)
    theta = fit_frequency(problem_of(flown)).theta
    if polish == "output error":
        problem = TimeProblem(
            structure=structure, parameters=structure.parameters, records=records, unknowns=("initial_state",)
        )
        theta = fit_output_error(problem, starts=[theta]).solution.theta
    parameters = structure.parameters.unpack(theta)
    if polish == "prediction error":
        posed = InnovationsProblem(structure=structure, parameters=parameters, records=records, hold="zero")
        parameters = fit_prediction_error(posed).parameters
    return structure.response(parameters.values, OMEGA_RAD_S)


def problem_of(flown: Flown) -> FrequencyProblem:
    """The measured response of the second order, without the hold of its input."""
    (u,), (y,) = SECOND_ORDER.inputs, SECOND_ORDER.outputs
    history = TimeHistory(
        values=np.vstack([flown.record.inputs, flown.record.outputs, flown.excitation]),
        channels=tuple(Channel(name=name, unit="rad") for name in (u, y, "excitation")),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    measured = frequency_response(
        [history],
        inputs=[u],
        outputs=[y],
        instruments=["excitation"],
        omega_rad_s=OMEGA_RAD_S,
        windows_s=WINDOWS_S,
    )
    half = 0.5 * measured.omega_rad_s / RATE_HZ
    response = replace(measured, values=measured.values / (np.sinc(half / np.pi) * np.exp(-1j * half)))
    return FrequencyProblem(
        structure=SECOND_ORDER,
        parameters=SECOND_ORDER.parameters,
        data=response,
        used=response.coherence > LEAST_COHERENCE,
    )


TUNED = "rotorid, black box of scanned order"


def tuned_black_box(job: Job) -> Peer:
    """Our black box with what peers have: an order and whole samples of delay that are scanned against the truth."""
    settings = tuple((order, 0, late) for order in job.orders for late in job.delays)

    def one(record: TimeData, setting: tuple[int, ...], omega: FloatArray) -> ComplexArray | None:
        order, _, late = setting
        moved = replace(
            record,
            inputs=record.inputs[:, : record.samples - late],
            outputs=record.outputs[:, late:],
        )
        plan = StartPlan(methods=("cva", "predictor"), drawn=0)
        names = [[f"{kind}{k}" for k in range(len(rows))] for kind, rows in (("u", moved.inputs), ("y", moved.outputs))]
        try:
            found = fit_black_box(
                [moved], order, inputs=names[0], outputs=names[1], unknowns=("initial_state",), plan=plan
            )
        except InsufficientDataError:
            return None
        response = found.structure.response(found.parameters.values, omega)
        # A model in continuous time, compared as those of samples are: with its hold on the side of the truth.
        hold = held(job.truth) / job.truth.response(omega)
        return np.asarray(response * hold * np.exp(-1j * omega * late / RATE_HZ))

    def every(records: Sequence[TimeData], tried: Sequence[tuple[int, ...]], omega: FloatArray) -> Responses:
        return [[one(record, setting, omega) for setting in tried] for record in records]

    return Peer(TUNED, settings, every)


DIRECT = "direct responses, the way of pyAircraftIden"


def direct_peer(job: Job, structure: LinearStructure) -> Peer:
    """The peer that knows the structure, and the hold, as ours do; it is fitted to the direct response.

    Settings: the longest window in seconds, how many windows of half the length each, and the least coherence in
    percent. Those that came closest to the truth of all flights, with sensor noise and in gusts, of windows of 10 to
    30 s, one to five of them, and coherences of 30 to 80 %.
    """
    settings = ((15, 2, 30), (20, 3, 80))
    half = 0.5 * OMEGA_RAD_S / RATE_HZ
    hold = np.sinc(half / np.pi) * np.exp(-1j * half)

    def one(record: TimeData, setting: tuple[int, ...], omega: FloatArray) -> ComplexArray:
        longest_s, count, least_percent = setting
        measured = direct_response(record, omega, tuple(longest_s / 2.0**k for k in range(count)))
        theta = fit_direct(structure, measured, omega, hold, least_percent / 100.0)
        found = structure.response(structure.parameters.unpack(theta).values, omega)
        return np.asarray(found * held(job.truth) / job.truth.response(omega))

    def every(records: Sequence[TimeData], tried: Sequence[tuple[int, ...]], omega: FloatArray) -> Responses:
        return [[one(record, setting, omega) for setting in tried] for record in records]

    return Peer(DIRECT, settings, every)


def black_box(flown: Flown) -> ComplexArray:
    plan = StartPlan(methods=("cva", "predictor"), drawn=0)
    found = fit_black_box(
        [flown.record], 4, inputs=["a", "b"], outputs=["y", "z"], unknowns=("initial_state",), plan=plan
    )
    return found.structure.response(found.parameters.values, OMEGA_RAD_S)


def subspace(flown: Flown) -> ComplexArray:
    """A model of samples, divided by what the hold makes of the truth."""
    model = fit_subspace([flown.record], 4)
    found = sampled(model.A, model.B, model.C, model.D, step_s=1.0 / RATE_HZ, omega=OMEGA_RAD_S)
    return found / held(FOUR_STATES) * FOUR_STATES.response(OMEGA_RAD_S)


def held(system: StateSpace) -> ComplexArray:
    """The truth as samples show it: models of samples are compared with that."""
    A, B, C, D = system.proper()
    step = discretize(A, B, delays_s=system.input_delays_s, step_s=1.0 / RATE_HZ, hold="zero")
    z = np.exp(1j * OMEGA_RAD_S / RATE_HZ)
    late = z ** -(step.lags[:, None] + 1.0)
    driven = sum(step.taps[tap].T[:, :, None] * (late * z**tap) for tap in range(3))
    states = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - step.transition, np.moveaxis(driven, -1, 0))
    direct = D[:, :, None] * sum(step.weights[tap, :, None] * (late * z**tap) for tap in range(2))
    return np.moveaxis(C @ states, 0, -1) + direct


def errors(found: Sequence[ComplexArray | None], truth: ComplexArray, setting: tuple[int, ...] = ()) -> Errors:
    """Over all flights; infinite where one was not identified."""
    if any(one is None or not np.isfinite(one).all() for one in found):
        return Errors(np.inf, np.inf, setting)
    ratios = np.array(found) / truth
    return Errors(
        float(np.sqrt(np.mean((20.0 * np.log10(np.abs(ratios))) ** 2))),
        float(np.sqrt(np.mean(np.degrees(np.angle(ratios)) ** 2))),
        setting,
    )


def best_tuned(peer: Peer, records: Sequence[TimeData], truth: ComplexArray) -> Errors:
    """Errors of a peer with the setting that comes closest to the truth."""

    def tried(settings: Sequence[tuple[int, ...]], flights: Sequence[TimeData]) -> list[Errors]:
        found = peer.responses(flights, settings, OMEGA_RAD_S)
        every = [errors([row[k] for row in found], truth, setting) for k, setting in enumerate(settings)]
        return sorted(every, key=lambda one: one.size)

    settings: Sequence[tuple[int, ...]] = peer.settings
    if len(settings) > KEPT:
        settings = [one.setting for one in tried(settings, records[:SCANNED])[:KEPT]]
    return tried(settings, records)[0]


def rows(job: Job, seeds: int = SEEDS) -> Iterator[tuple[str, Errors]]:
    """Our methods, then the peers that are here."""
    flights = [job.fly(seed) for seed in range(seeds)]
    for name, method in job.ours.items():
        yield name, errors([method(flown) for flown in flights], job.truth.response(OMEGA_RAD_S))
    records, truth = [flown.record for flown in flights], held(job.truth)
    tuned = tuned_black_box(job)
    yield tuned.name, best_tuned(tuned, records, truth)
    if job.structure is not None:
        direct = direct_peer(job, job.structure)
        yield direct.name, best_tuned(direct, records, truth)
    for peer in peers(outputs=len(truth), orders=job.orders, delays=job.delays):
        yield peer.name, best_tuned(peer, records, truth)


def jobs() -> tuple[Job, ...]:
    return closed_loop(), closed_loop(gusts=GUSTS), four_states()


def skipped() -> Iterator[str]:
    """A sentence for the peers that are not here."""
    if absent := missing():
        yield f"peers skipped: {', '.join(absent)} not found; {INSTALL}"


def main() -> None:
    """Print the tables."""
    for job in jobs():
        print(f"{job.name:44} {'[dB]':>8} {'[deg]':>8}  order, horizon, samples of delay")
        for name, found in rows(job):
            setting = ", ".join(map(str, found.setting))
            print(f"  {name:42} {found.magnitude_db:8.3f} {found.phase_deg:8.2f}  {setting}", flush=True)
        print(f"  {'bar of ours':42} {BAR_DB:8.3f} {BAR_DEG:8.2f}\n")
    for sentence in skipped():
        print(sentence)


if __name__ == "__main__":
    main()
