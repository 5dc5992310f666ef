r"""The fit of force: what enters, which lags and filters, which wind, by the error of data that were not fitted.

Every fit has ``c_2``, ``c_lambda``, ``k_d`` and the place of the accelerometer, as far as flights show them; motors
that are known by outputs have a lag and a curve too. Then terms are tried one after the other, in the order of a
ladder. They stay if they lower the error of data that were not fitted by a hundredth, both where thirds of every record
and where whole records are left out in turn: thirds alone let in what differs from flight to flight, whole records
alone what one flight of two cannot show.

Where vertical speed and load hardly changed, thrust without inflow and what inflow takes are one number, and their
ratio is that of a usual propeller: ``c_lambda`` is tied. Where airspeed hardly changed, there is no drag to find.

The wind of a record is what drag needs to have no mean over the earth:

.. math:: W \leftarrow W + \arg\min_{\Delta} \sum \left|r_{xy} - \tfrac{1}{m} k_d \sum_i \Omega_i \,
    (R^T \Delta)_{xy}\right|^2

with the residual r of the specific force, five times over. Winds too stay only if they lower the error of data that
were not fitted, since there is none in a room. A bias of the accelerometer is the same in body axes, and counts as zero
within 0.2 m/s²: where the heading turns by less than a quarter of a circle, wind is no better known than that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.force import (
    PLACE,
    ForceRows,
    Prior,
    Products,
    force_rows,
    left_over,
    solved,
    thinned,
    thinning,
    total,
)
from rotorid.fitting.flight.motion import Motion, VelocityClass, curve_columns, motion
from rotorid.frames import earth_to_body
from rotorid.models.flight import (
    ALONG_BODY_BIAS_M_S2,
    CURVE_TERMS,
    FORCE_TERMS,
    QUARTER_TURN_RAD,
    Airframe,
    full_thrust,
    hover_thrust,
)
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

LADDER: tuple[str, ...] = ("k_w", "c_h", "c_hw", "c_ha", "d_z")
"""Terms beyond those of every fit, in the order in which they are tried."""

_FAST_M_S = 8.0
_CLIMBING_M_S = 6.0
"""Airspeed, and range of vertical speed, from which the terms of fast flight are tried."""

_LEAST_CLIMB_M_S, _LEAST_LOAD = 1.0, 1.3
_LEAST_EDGE_M_S = 1.0
_LEAST_RATE_RAD_S, _LEAST_TURNING_RAD_S2 = 1.0, 1.0
_POSITIVE = ("c_lambda", "k_d")
_NO_BETTER = "data that were not fitted are no better"
_SUPERFLUOUS = "later terms do the same"

USUAL_BEND, USUAL_REST = 0.5, 0.03
"""Parts of thrust at the mean output that go with the output and that are constant: about zero, as surely as this."""

LINE: Mapping[str, float] = {"c_0": 0.0, "c_2": 0.0}
"""What of a curve is known of thrust that follows the outputs in a line."""

_MOTOR_LAGS_S = (0.005, 0.01, 0.02, 0.03, 0.045, 0.065, 0.09, 0.13, 0.19)
_CUTOFFS_HZ = tuple(float(value) for value in np.geomspace(3.0, 24.0, 13))
_MOTOR_LAG_S = 0.04
_ROUNDS = 5
_SETTLED, _SETTLED_M_S = 1e-4, 0.005
_TOGETHER_S, _WHITE_S = 1.0, 0.05
_BLOCK_S = 2.0
_WIND_M_S, _STORM_M_S = 5.0, 15.0
_USUAL_DRAG_1_S = 0.3

_USUAL_SHARE = 1.35
"""Thrust without inflow over that in hover."""

_USUAL_LOSS = (_USUAL_SHARE - 1.0) / _USUAL_SHARE
"""Share of it that inflow takes in hover."""


class Rung(NamedTuple):
    """One step of the ladder: terms that were tried together.

    Parameters
    ----------
    terms
        Their names.
    before, after
        Root mean square of the error of force, N, on data that were not fitted, without and with them.
    entered
        Whether they were kept.
    why
        Why not, in a few words; empty where they were.
    """

    terms: tuple[str, ...]
    before: float
    after: float
    entered: bool
    why: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceFit(Immutable):
    """The force of flight with its numbers.

    Parameters
    ----------
    values
        Parameter to value, held ones included.
    free
        Those that were fitted.
    entered
        Terms that the ladder added.
    ladder
        What was tried.
    missing
        Terms that the records cannot show, and why.
    winds, wind_stds
        Of each record, toward north and east, m/s; not finite where none was fitted.
    cutoff_hz
        Of the low-pass that stands for the accelerometers' filter.
    """

    values: Mapping[str, float]
    free: tuple[str, ...]
    entered: tuple[str, ...]
    ladder: tuple[Rung, ...]
    missing: Mapping[str, str]
    winds: FloatArray
    wind_stds: FloatArray
    cutoff_hz: float | None


class ForceChoices(NamedTuple):
    """What is decided before force is fitted; see :class:`rotorid.fitting.flight.fit.FlightChoices`."""

    known: Mapping[str, float]
    terms: tuple[str, ...] | None
    kind: VelocityClass
    wind: bool
    cutoff_hz: float | None
    skews_s: FloatArray
    least_gain: float
    straight: bool = False


def fit_force(records: Sequence[MotorRecord], airframe: Airframe, choices: ForceChoices) -> ForceFit:
    """Fit the force of flight; see the module.

    Parameters
    ----------
    records
        With specific force along all axes.
    airframe
        What is known of the vehicle.
    choices
        What is decided before.
    """
    search = _Search(tuple(records), airframe, choices)
    search.shown()
    if not search.measured:
        search.find_outputs()
    search.settle()
    ladder = []
    if choices.wind and "k_d" in search.names:
        ladder.append(search.wind_rung())
    for term in LADDER:
        if search.tried(term):
            why = search.unseen(term)
            if why:
                search.missing[term] = why
            else:
                ladder.append(search.rung(term))
    ladder = search.pruned(ladder)
    entered = tuple(term for rung in ladder if rung.entered for term in rung.terms if term in LADDER)
    search.settle()
    return ForceFit(
        values=search.values,
        free=search.free(),
        entered=entered,
        ladder=tuple(ladder),
        missing={name: why for name, why in search.missing.items() if name not in choices.known},
        winds=search.winds,
        wind_stds=search.wind_stds(),
        cutoff_hz=search.cutoff_hz,
    )


def wind_of(
    values: Mapping[str, float],
    airframe: Airframe,
    record: MotorRecord,
    *,
    kind: VelocityClass,
    cutoff_hz: float | None = None,
    skew_s: float = 0.0,
    least_gain: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Wind of a flight in which a vehicle is known, toward north and east, and its standard deviation.

    In m/s, shape ``(2,)`` each; not finite where data that were not fitted gain less by a wind.

    Parameters
    ----------
    values
        Of the vehicle; what they lack counts as zero.
    record
        With specific force, attitude and velocity.
    kind, cutoff_hz, skew_s, least_gain
        As in a fit.
    """
    zeros = dict.fromkeys((*FORCE_TERMS, *PLACE, "T_motor"), 0.0)
    choices = ForceChoices({**zeros, **values}, (), kind, True, cutoff_hz, np.array([skew_s]), least_gain)
    found = fit_force((record,), airframe, choices)
    return found.winds[0], found.wind_stds[0]


class _Search:
    """A fit on its way: which columns count, and numbers, filter and winds as they are now."""

    def __init__(self, records: tuple[MotorRecord, ...], airframe: Airframe, choices: ForceChoices) -> None:
        self.records, self.airframe, self.choices = records, airframe, choices
        self.measured = all(record.between == "lines" for record in records)
        self.names: list[str] = []
        self.motor_lag_shown = False
        self.line = LINE.items() <= choices.known.items() and "c_1" not in choices.known
        """Whether thrust is a line of the outputs through zero."""
        known_curve = any(term in choices.known for term in CURVE_TERMS) and not self.line
        self.shaped = not (self.measured or known_curve) and (
            choices.terms is None or "c_1" in choices.terms or not choices.terms
        )
        """Whether the thrust curve of outputs is sought."""
        self.tied = False
        self.missing: dict[str, str] = {}
        self.values: dict[str, float] = dict(choices.known)
        self.cutoff_hz = choices.cutoff_hz
        self.winds = np.full((len(records), 2), np.nan)
        self.weights: list[FloatArray | None] = [None] * len(records)
        speeds = [moved.speeds for moved in self.driven()]
        weight = [airframe.mass_kg * max(-float(record.force[2].mean()), 1.0) for record in records]
        squares = [max(float((rows**2).sum(axis=0).mean()), 1e-300) for rows in speeds]
        self.by_speed = np.array(weight) / np.array(squares)
        self.load_n = float(np.mean(weight)) / airframe.rotors
        """Mean thrust of a rotor."""
        self.level = float(np.mean([record.outputs.mean() for record in records]))
        self.speed = float(np.mean([rows.mean() for rows in speeds]))
        seconds = sum(record.duration_s for record in records)
        # Errors that are made white are not alike for long.
        together_s = _WHITE_S if self.shaped else _TOGETHER_S
        self.samples_together = together_s * sum(rows.measured.shape[1] for rows in self.rows(("c_2",))) / seconds

    @property
    def windy(self) -> bool:
        """Whether each record has a wind."""
        return bool(np.isfinite(self.winds).all())

    # What the records show.

    def shown(self) -> None:
        """Columns of every fit, as far as the records move enough; the others are missing."""
        driven = self.driven()
        names = ["c_2"]
        if self.choices.kind == "none":
            self.missing |= dict.fromkeys(("c_lambda", "k_d", *LADDER), "neither velocity nor attitude is known")
        else:
            names.append("c_lambda")
            climb = np.concatenate([moved.velocity[2] for moved in driven])
            load = np.concatenate([-record.force[2] for record in self.records]) / STANDARD_GRAVITY_M_S2
            highest = float(np.quantile(load, 0.995))
            if float(climb.std()) < _LEAST_CLIMB_M_S and highest < _LEAST_LOAD:
                self.tied = "c_lambda" not in self.choices.known
                self.missing["c_lambda"] = (
                    f"vertical speed varied by {climb.std():.2g} m/s and load reached {highest:.2g} g, so it is tied "
                    "to c_2"
                )
            edge = float(np.sqrt(sum(np.concatenate([moved.velocity[k] for moved in driven]).var() for k in (0, 1))))
            if edge >= _LEAST_EDGE_M_S:
                names.append("k_d")
            else:
                self.missing["k_d"] = f"airspeed varied by {edge:.2g} m/s ({_LEAST_EDGE_M_S:g} needed)"
        rates = np.concatenate([np.abs(moved.rates).max(axis=0) for moved in driven])
        turning = np.concatenate([moved.acceleration for moved in driven], axis=1)
        if np.quantile(rates, 0.995) >= _LEAST_RATE_RAD_S and turning.std() >= _LEAST_TURNING_RAD_S2:
            names += PLACE
        else:
            self.missing |= dict.fromkeys(PLACE, "the vehicle turned too little")
        names = [*(CURVE_TERMS[:2] if self.shaped else ()), *names]
        self.names = list(dict.fromkeys([*names, *(n for n in self.choices.known if n in (*FORCE_TERMS, *PLACE))]))
        self.speeds_m_s = (
            float(np.quantile(np.concatenate([np.sqrt((moved.velocity**2).sum(axis=0)) for moved in driven]), 0.995)),
            float(np.ptp(np.quantile(np.concatenate([moved.velocity[2] for moved in driven]), (0.01, 0.99)))),
        )

    def tried(self, term: str) -> bool:
        """Whether a term of the ladder may enter."""
        terms = self.choices.terms
        return term not in self.choices.known and term not in self.missing and (terms is None or term in terms)

    def unseen(self, term: str) -> str:
        """Why flights cannot show a term; empty where they can."""
        fastest, climbs = self.speeds_m_s
        if fastest < _FAST_M_S:
            return f"airspeed reached {fastest:.2g} m/s ({_FAST_M_S:g} needed)"
        if term != "c_h" and climbs < _CLIMBING_M_S:
            return f"vertical speed covered {climbs:.2g} m/s ({_CLIMBING_M_S:g} needed)"
        return ""

    def free(self) -> tuple[str, ...]:
        """Numbers that were fitted."""
        found = [name for name in self.names if not (name == "c_lambda" and self.tied)]
        found += ["T_motor"] * self.motor_lag_shown
        return tuple(name for name in found if name not in self.choices.known)

    # Columns, and their coefficients.

    def driven(self, at: Mapping[str, float] | None = None) -> list[Motion]:
        """What drives the model over each record."""
        values = self.values | dict(at or {})
        return [
            motion(record, values, kind=self.choices.kind, wind=wind, skew_s=float(skew))
            for record, wind, skew in zip(self.records, self.winds, self.choices.skews_s, strict=True)
        ]

    def rows(self, names: Sequence[str], at: Mapping[str, float] | None = None) -> list[ForceRows]:
        """Columns of each record."""
        values = self.values | dict(at or {})
        curves = [
            curve_columns(record, values, skew_s=float(skew)) if self.shaped else None
            for record, skew in zip(self.records, self.choices.skews_s, strict=True)
        ]
        made = [
            force_rows(record, self.airframe, moved, float(by_speed), names, curve)
            for record, moved, by_speed, curve in zip(self.records, self.driven(at), self.by_speed, curves, strict=True)
        ]
        return [replace(row, weights=weights) for row, weights in zip(made, self.weights, strict=True)]

    def solve(self, products: Products, names: Sequence[str]) -> FloatArray:
        """Coefficients of all columns of these names; drag and what inflow takes are not negative."""
        held = np.array([self._held(name) for name in names])
        found = self._solve(products, names, held)
        below = [k for k, name in enumerate(names) if name in _POSITIVE and found[k] < 0.0]
        if below:
            held[below] = 0.0
            found = self._solve(products, names, held)
        return found

    def _held(self, name: str) -> float:
        known = self.choices.known
        # A square whose size is not known has no other terms.
        if name == "c_2" and "c_2" in known:
            return full_thrust(known)
        return known.get(name, np.nan)

    def _solve(self, products: Products, names: Sequence[str], held: FloatArray) -> FloatArray:
        free, mixed = self.freed(names, held)
        fixed = np.where(np.isnan(held), 0.0, held)
        if self.tied and "c_lambda" in names and "c_2" not in free:
            fixed[names.index("c_lambda")] = self.tie * fixed[names.index("c_2")]
        left = products.without(fixed).of(mixed)
        return np.asarray(fixed + mixed @ solved(left, free, self.priors(), together=self.samples_together))

    @property
    def tie(self) -> float:
        """Usual ratio of what inflow takes to thrust without it."""
        return self.priors()["c_lambda"].mean / (_USUAL_SHARE * float(self.by_speed.mean()))

    def freed(self, names: Sequence[str], held: FloatArray) -> tuple[list[str], FloatArray]:
        """What is solved for, and the coefficients it makes, shape ``(names, free)``.

        Of a curve, these are thrust at the mean output, the part of it that goes with the output, and a constant one.
        """
        free = [name for name, value in zip(names, held, strict=True) if np.isnan(value)]
        if self.tied:
            free = [name for name in free if name != "c_lambda"]
        mixed = np.array([[float(name == one) for one in free] for name in names]).reshape(len(names), len(free))
        if self.shaped and not self.line:
            u = self.level
            to = np.array([[1.0, 0.0, 0.0], [-1.0 / u, 1.0 / u, 0.0], [0.0, -1.0 / u**2, 1.0 / u**2]])
            rows, columns = ([of.index(term) for term in CURVE_TERMS] for of in (list(names), free))
            mixed[np.ix_(rows, columns)] = to
        if self.tied and "c_lambda" in names:
            terms = [place for place, name in enumerate(names) if name in CURVE_TERMS]
            mixed[list(names).index("c_lambda")] = self.tie * mixed[terms].sum(axis=0)
        return free, mixed

    def priors(self) -> dict[str, Prior]:
        """What is usual before the flights are looked at."""
        by_speed = float(self.by_speed.mean())
        weight = self.airframe.mass_kg * STANDARD_GRAVITY_M_S2 / self.airframe.rotors
        hover = float(np.sqrt(weight / by_speed))
        induced = float(np.sqrt(weight / (2.0 * self.airframe.density_kg_m3 * self.airframe.disc_m2)))
        square = _USUAL_SHARE * by_speed
        lost, drag = _USUAL_LOSS * square * hover / induced, _USUAL_DRAG_1_S * weight / STANDARD_GRAVITY_M_S2 / hover
        level = square if self.choices.kind != "none" else by_speed
        curve = {"c_2": Prior(level, 0.3 * square)}
        if self.shaped:
            share = _USUAL_SHARE if self.choices.kind != "none" else 1.0
            thrust = share * self.load_n
        if self.shaped and self.line:
            curve = {"c_1": Prior(thrust / self.level, 0.3 * thrust / self.level)}
        elif self.shaped:
            curve = {
                "c_0": Prior(0.0, USUAL_REST * thrust),
                # About a line where the autopilot takes the curve out, else about a square.
                "c_1": Prior(thrust if self.choices.straight else 0.0, USUAL_BEND * thrust),
                "c_2": Prior(thrust, 0.3 * thrust),
            }
        return {
            **curve,
            "c_lambda": Prior(lost, 0.5 * lost),
            "k_d": Prior(drag, drag),
            **dict.fromkeys(PLACE, Prior(0.0, 0.03)),
        }

    # Steps of the search.

    def settle(self) -> None:
        """Coefficients, filter, inflow and winds, one after the other until they stay."""
        for _ in range(_ROUNDS):
            before = self.winds.copy(), self.by_speed.copy()
            rows = self.rows(self.names)
            found = self._filtered(rows)
            if self.shaped:
                self.weights = [row.whitening(found, self.cutoff_hz) for row in rows]
            self._take(found)
            if self.windy:
                self._blow(rows, found)
            moved = np.abs(self.by_speed / before[1] - 1.0).max()
            if moved < _SETTLED and np.abs(np.nan_to_num(self.winds - before[0])).max() < _SETTLED_M_S:
                break

    def _filtered(self, rows: Sequence[ForceRows]) -> FloatArray:
        """Coefficients at the cut-off of the least error."""
        cutoffs: tuple[float | None, ...] = (*_CUTOFFS_HZ, None)
        if self.choices.cutoff_hz is not None or all(part.taps.size > 1 for part in rows):
            cutoffs = (self.choices.cutoff_hz,)
        best: tuple[float, float | None, FloatArray] | None = None
        for cutoff_hz in cutoffs:
            products = total([part.products(cutoff_hz) for part in rows])
            found = self.solve(products, self.names)
            left = float(left_over(products, found).sum())
            if best is None or left < best[0]:
                best = left, cutoff_hz, found
        if best is None:  # there is always a first one
            raise AssertionError
        self.cutoff_hz = best[1]
        return best[2]

    def _take(self, found: FloatArray) -> None:
        """Coefficients as values, and the inflow of hover that follows."""
        values = dict(zip(self.names, found.tolist(), strict=True))
        self.values |= values | dict(self.choices.known)
        self.by_speed = np.full(len(self.records), hover_thrust(self.values, self.airframe).coefficient)

    def _first_winds(self) -> FloatArray:
        """Winds to begin with, by one regression of the force along the discs on motion and winds.

        Without them, a flight that is held against its wind shows no drag or a negative one, and no drag shows no wind.
        """
        rows, columns = self.rows(("k_d",)), self._wind_columns(by=1.0)
        count = 2 * len(rows)
        matrix, right = np.zeros((1 + count, 1 + count)), np.zeros(1 + count)
        for place, (part, toward) in enumerate(zip(rows, columns, strict=True)):
            used = [0, 1 + 2 * place, 2 + 2 * place]
            flat = np.stack([part.columns[0][:2], *toward[:, :2]]).reshape(3, -1)
            matrix[np.ix_(used, used)] += flat @ flat.T
            right[used] += flat @ part.measured[:2].ravel()
        drag, *pushed = np.linalg.lstsq(matrix, right, rcond=1e-10)[0].tolist()
        if not drag > 0.0:
            return np.zeros((len(rows), 2))
        return np.asarray(np.clip(np.array(pushed).reshape(-1, 2) / drag, -_STORM_M_S, _STORM_M_S))

    def _blow(self, rows: Sequence[ForceRows], found: FloatArray) -> None:
        for place, (part, columns) in enumerate(zip(rows, self._wind_columns(), strict=True)):
            left = part.measured - np.tensordot(found, part.columns, 1)
            step, _ = _wind(columns, left, part.sample_rate_hz)
            self.winds[place] += step

    def _wind_columns(self, by: float | None = None) -> list[FloatArray]:
        """Specific force of a wind of one toward north and east, in body axes, by record, shape ``(2, 3, n)``.

        Parameters
        ----------
        by
            Drag coefficient of the rotors; by default the one that was found.
        """
        drag = self.values.get("k_d", 0.0) if by is None else by
        found = []
        for record, moved in zip(self.records, self.driven(), strict=True):
            pushed = drag * moved.speeds.sum(axis=0) / self.airframe.mass_kg
            toward = [earth_to_body(record.attitude, np.tile(axis[:, None], record.samples)) for axis in np.eye(3)[:2]]
            columns = np.stack(toward) * pushed
            columns[:, 2] = 0.0
            found.append(thinned(columns, thinning(record)))
        return found

    def wind_stds(self) -> FloatArray:
        """One standard deviation of the winds: blocks of two seconds, and the bias of the accelerometer."""
        stds = np.full((len(self.records), 2), np.nan)
        if not self.windy:
            return stds
        found = np.array([self.values[name] for name in self.names])
        if not self.shaped:
            found[self.names.index("c_2")] = full_thrust(self.values)
        for place, (part, columns) in enumerate(zip(self.rows(self.names), self._wind_columns(), strict=True)):
            left = part.measured - np.tensordot(found, part.columns, 1)
            _, variance = _wind(columns, left, part.sample_rate_hz)
            turned = float(np.ptp(np.unwrap(self.records[place].attitude[2])))
            if turned < QUARTER_TURN_RAD:
                variance = variance + (ALONG_BODY_BIAS_M_S2 / max(float(np.abs(columns).max()), 1e-9)) ** 2
            stds[place] = np.sqrt(variance)
        return stds

    def find_outputs(self) -> None:
        """Lag of the motors, which outputs need: the usual one, unless force shows another."""
        known, least = self.choices.known, (1.0 - self.choices.least_gain) ** 2
        self.values["T_motor"] = known.get("T_motor", _MOTOR_LAG_S)
        self.settle()
        if "T_motor" in known:
            return
        found = _lowest(_MOTOR_LAGS_S, [self._lost({"T_motor": lag_s}) for lag_s in _MOTOR_LAGS_S])
        if self._lost({"T_motor": found}) < least * self._lost({}):
            self.values["T_motor"], self.motor_lag_shown = found, True
        else:
            self.missing["T_motor"] = "force is no worse with a usual lag"

    def _lost(self, at: Mapping[str, float]) -> float:
        """Sum of squares that the columns of every fit leave at some lag and curve."""
        products = total([part.products(self.cutoff_hz) for part in self.rows(self.names, at)])
        return float(left_over(products, self.solve(products, self.names)).sum())

    # Rungs of the ladder.

    def _parts(self, names: Sequence[str]) -> list[list[Products]]:
        """Products of what is left out in turn: thirds of every record, and whole records where there are several."""
        rows = self.rows(names)
        wholes = [row.products(self.cutoff_hz) for row in rows]
        thirds = [part for whole in wholes for part in whole.thirds()]
        return [thirds, wholes] if len(rows) > 1 else [thirds]

    def _unseen_error(self, parts: Sequence[Products], names: Sequence[str]) -> float:
        """Error on parts that were left out in turn, N."""
        lost, samples = 0.0, 0
        for place, part in enumerate(parts):
            found = self.solve(total([other for k, other in enumerate(parts) if k != place]), names)
            lost += float(left_over(part, found).sum())
            samples += part.samples * part.blocks
        return self.airframe.mass_kg * float(np.sqrt(lost / samples))

    def wind_rung(self) -> Rung:
        """Whether a wind of each record lowers the error of thirds that were not fitted; indoors there is none."""
        before = self._unseen_error(self._parts(self.names)[0], self.names)
        self.winds = self._first_winds()
        self.settle()
        after = self._unseen_error(self._parts(self.names)[0], self.names)
        entered = after < (1.0 - self.choices.least_gain) * before
        if not entered:
            self.winds = np.full((len(self.records), 2), np.nan)
            self.settle()
        return Rung(("wind",), before, after, entered, "" if entered else _NO_BETTER)

    def rung(self, term: str) -> Rung:
        """Whether a term lowers the error of data that were not fitted, whichever way they are left out."""
        names = [*self.names, term]
        before, after = self._least_gain(names, term)
        entered = after < (1.0 - self.choices.least_gain) * before
        if entered:
            self.names = names
        return Rung((term,), before, after, entered, "" if entered else _NO_BETTER)

    def pruned(self, ladder: Sequence[Rung]) -> list[Rung]:
        """The ladder without terms that later ones have made superfluous."""
        found = []
        for rung in ladder:
            (term, *_) = rung.terms
            if rung.entered and term in LADDER:
                before, after = self._least_gain(self.names, term)
                if after >= (1.0 - self.choices.least_gain) * before:
                    self.names = [name for name in self.names if name != term]
                    rung = Rung(rung.terms, before, after, False, _SUPERFLUOUS)
            found.append(rung)
        return found

    def _least_gain(self, names: Sequence[str], term: str) -> tuple[float, float]:
        """Errors of unseen data without and with a term, the way of leaving data out that it gains least by."""
        fewer = np.eye(len(names))[:, [place for place, name in enumerate(names) if name != term]]
        others = [name for name in names if name != term]
        errors = [
            (self._unseen_error([part.of(fewer) for part in parts], others), self._unseen_error(parts, names))
            for parts in self._parts(names)
        ]
        return max(errors, key=lambda pair: pair[1] / pair[0])


def _lowest(grid: Sequence[float], losses: Sequence[float]) -> float:
    """Where a parabola through the least loss of a grid and its neighbors is lowest."""
    k = int(np.argmin(losses))
    if k in (0, len(grid) - 1):
        return float(grid[k])
    bent, slope, _ = np.polyfit(grid[k - 1 : k + 2], losses[k - 1 : k + 2], 2)
    return float(np.clip(-0.5 * slope / bent, grid[k - 1], grid[k + 1])) if bent > 0.0 else float(grid[k])


def _wind(columns: FloatArray, left: FloatArray, sample_rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Wind that explains what is left, and its variances by blocks of two seconds, shape ``(2,)`` each."""
    flat = columns.reshape(2, -1)
    variance = float((left[:2] ** 2).mean()) * sample_rate_hz * _TOGETHER_S
    matrix = flat @ flat.T + variance / _WIND_M_S**2 * np.eye(2)
    inverse = np.linalg.pinv(matrix, hermitian=True)
    step = inverse @ (flat @ left.ravel())
    rest = left - np.tensordot(step, columns, 1)
    scores = (columns * rest).sum(axis=1)
    length = max(1, round(_BLOCK_S * sample_rate_hz))
    blocks = np.add.reduceat(scores, np.arange(0, scores.shape[1], length), axis=1)
    return np.asarray(step), np.asarray(np.diagonal(inverse @ (blocks @ blocks.T) @ inverse))
