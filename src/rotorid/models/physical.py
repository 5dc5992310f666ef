r"""The physics of hover: derivatives from mass, inertia and rotors, and back from derivatives to these.

Four rotors in a plus: front, right, rear, left, at the distance :math:`l` from the axis of the vehicle and the height
:math:`z` above the center of gravity. Rotor :math:`i` turns with :math:`n_i` revolutions per second and moves through
the air with the velocity :math:`V_i` of its hub, which is that of the vehicle plus rates times lever:

.. math::

    T_i &= c_T(J_i) \, \rho n_i^2 D^4, \qquad J_i = -w_i / (n_i D), \qquad c_T(J) = c_T + \frac{dc_T}{dJ} J

    F_i &= -c_H \, \rho n_i D^3 \, (u_i, v_i, 0)^T \sqrt{u_i^2 + v_i^2} / |V_i| - (0, 0, T_i)^T

    M_i &= r_i \times F_i + (-1)^i \left(0, 0, \frac{c_P}{2\pi} \rho n_i^2 D^5\right)^T

Assumed: no wind, a rigid vehicle in hover, no drag of the body, no inflow of one rotor into another. What breaks it:
ducts, coaxial or tilted rotors, ground effect, and speeds where :math:`c_T` is no straight line.

Source: Niermeyer, Raffler and Holzapfel, *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via
Closed-Loop Flight Testing*, eqs 1 to 6. The derivatives printed there (eqs 8 to 10) contain misprints: a power of D in
M_u, the inertia of N_r, the sign of Z_thrust and of a term of M_q. Those here follow from the forces.

The way back solves these equations for what is unknown, with the uncertainty that comes along, and says where numbers
are none that physics allows: of the inertia of a rigid body, of weight and thrust, of the signs of coefficients.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, warn
from rotorid.errors import ModelError, nearest_name
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

Number = TypeVar("Number", float, complex)

PHYSICAL_UNITS: Mapping[str, str] = {
    "m": "kg",
    "I_xx": "kg m^2",
    "I_yy": "kg m^2",
    "I_zz": "kg m^2",
    "c_T": "1",
    "dc_T_dJ": "1",
    "c_H": "1",
    "c_P": "1",
    "D": "m",
    "l": "m",
    "z": "m",
    "rho": "kg/m^3",
    "k_n": "1/s",
    "n_h": "1/s",
}
"""Physical parameters and their units: mass, inertia, coefficients of a rotor, its diameter, the arm, the height of the
rotors above the center of gravity, density of the air, speed per command and speed in hover (revolutions a second)."""

MIXER: FloatArray = np.array(
    [[0.0, 1.0, -1.0, 1.0], [-1.0, 0.0, 1.0, 1.0], [0.0, -1.0, -1.0, 1.0], [1.0, 0.0, 1.0, 1.0]]
)
"""Commands of roll, pitch, yaw and thrust (columns) to speeds of the rotors, in units of ``k_n`` (eq 6, inverted)."""
MIXER.setflags(write=False)


def hover_speed(physics: Mapping[str, Number]) -> Number:
    r"""Rotor speed that carries the weight, revolutions per second.

    .. math:: n_h = \sqrt{m g / (4 c_T \rho D^4)}

    Parameters
    ----------
    physics
        At least ``m``, ``c_T``, ``rho`` and ``D``.

    Examples
    --------
    >>> round(hover_speed({"m": 1.5, "c_T": 0.1, "rho": 1.225, "D": 0.25}), 2)
    87.67
    """
    thrust = 4.0 * physics["c_T"] * physics["rho"] * physics["D"] ** 4
    speed: Number = (STANDARD_GRAVITY_M_S2 * physics["m"] / thrust) ** 0.5
    return speed


def hover_derivatives(physics: Mapping[str, Number]) -> dict[str, Number]:
    r"""Stability and control derivatives in hover from physical parameters: the forces of this module, linearized.

    With :math:`k = c_H \rho n_h D^3`, :math:`k_T = (dc_T/dJ) \rho n_h D^3` and :math:`s = 1 + |z|/\sqrt{z^2 + l^2}`,

    .. math::

        X_u &= Y_v = -4 k/m, & X_q &= -Y_p = 2 k z s/m, & M_u &= 4 k z/I_{yy}, & L_v &= -4 k z/I_{xx}

        M_q &= 2 (k_T l^2 - k z^2 s)/I_{yy}, & N_r &= -4 k l^2/I_{zz}, & Z_w &= 4 k_T/m

        M_{pitch} &= 4 k_n l c_T \rho n_h D^4/I_{yy}, & N_{yaw} &= 4 k_n c_P \rho n_h D^5/(\pi I_{zz}), &
        Z_{thrust} &= -8 k_n c_T \rho n_h D^4/m

    and for roll as for pitch with :math:`I_{xx}`. Where the rotors carry the weight, Z_thrust is
    :math:`-2 g k_n/n_h`. The side force has no gradient at rest, only a slope along each single motion; a motion of
    several at once adds up differently (:math:`s` does not apply), which the linear model cannot show.

    Parameters
    ----------
    physics
        Every name of :data:`PHYSICAL_UNITS`. Complex numbers pass, for derivatives by a complex step.

    Examples
    --------
    >>> typical = dict(m=1.5, I_xx=0.03, I_yy=0.03, I_zz=0.055, c_T=0.1, dc_T_dJ=-0.13, c_H=0.05, c_P=0.04)
    >>> geometry = dict(D=0.25, l=0.25, z=0.03, rho=1.225, k_n=100.0, n_h=87.67)
    >>> {name: round(value, 2) for name, value in hover_derivatives(typical | geometry).items()}["M_u"]
    0.34
    """
    m, I_xx, I_yy, I_zz = (physics[name] for name in ("m", "I_xx", "I_yy", "I_zz"))
    D, l, z, k_n = (physics[name] for name in ("D", "l", "z", "k_n"))  # noqa: E741
    flow = physics["rho"] * physics["n_h"] * D**3
    drag, inflow = physics["c_H"] * flow, physics["dc_T_dJ"] * flow
    thrust = k_n * physics["c_T"] * flow * D
    # (z**2)**0.5 is |z| and, unlike abs, differentiable by a complex step.
    tilt = 1.0 + (z**2 / (z**2 + l**2)) ** 0.5
    damping = 2.0 * (inflow * l**2 - drag * z**2 * tilt)
    return {
        "X_u": -4.0 * drag / m,
        "Y_v": -4.0 * drag / m,
        "X_q": 2.0 * drag * z * tilt / m,
        "Y_p": -2.0 * drag * z * tilt / m,
        "M_u": 4.0 * drag * z / I_yy,
        "L_v": -4.0 * drag * z / I_xx,
        "M_q": damping / I_yy,
        "L_p": damping / I_xx,
        "L_roll": 4.0 * l * thrust / I_xx,
        "M_pitch": 4.0 * l * thrust / I_yy,
        "N_r": -4.0 * drag * l**2 / I_zz,
        "N_yaw": 4.0 * k_n * physics["c_P"] * flow * D**2 / (math.pi * I_zz),
        "Z_w": 4.0 * inflow / m,
        "Z_thrust": -8.0 * thrust / m,
    }


def rotor_forces(
    physics: Mapping[str, float], velocity_m_s: FloatArray, rates_rad_s: FloatArray, speeds_rev_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Force and moment of all rotors on the vehicle, not linearized; the equations stand at the head of the module.

    Parameters
    ----------
    physics
        ``c_T``, ``dc_T_dJ``, ``c_H``, ``c_P``, ``D``, ``l``, ``z`` and ``rho``.
    velocity_m_s
        ``u v w`` of the center of gravity through the air, shape ``(3,)``.
    rates_rad_s
        ``p q r``, shape ``(3,)``.
    speeds_rev_s
        Of the front, right, rear and left rotor, all positive, shape ``(4,)``.

    Returns
    -------
    numpy.ndarray
        Force along the body axes in newtons, shape ``(3,)``.
    numpy.ndarray
        Moment around the center of gravity in newton meters, shape ``(3,)``.
    """
    rho, D, l, z = (physics[name] for name in ("rho", "D", "l", "z"))  # noqa: E741
    hubs = np.array([[l, 0.0, -z], [0.0, l, -z], [-l, 0.0, -z], [0.0, -l, -z]])
    n = np.asarray(speeds_rev_s)
    velocities = np.asarray(velocity_m_s) + np.cross(rates_rad_s, hubs)
    speed, sideways = np.linalg.norm(velocities, axis=1), np.hypot(velocities[:, 0], velocities[:, 1])
    inclination = np.divide(sideways, speed, out=np.zeros(4), where=speed > 0.0)
    advance = -velocities[:, 2] / (n * D)
    thrust = (physics["c_T"] + physics["dc_T_dJ"] * advance) * rho * n**2 * D**4
    forces = -(physics["c_H"] * rho * n * D**3 * inclination)[:, None] * velocities
    forces[:, 2] = -thrust
    shaft = np.array([-1.0, 1.0, -1.0, 1.0]) * physics["c_P"] / (2.0 * np.pi) * rho * n**2 * D**5
    moment = np.cross(hubs, forces).sum(axis=0)
    moment[2] += shaft.sum()
    return forces.sum(axis=0), moment


_TRIANGLE_ROUNDING = 1e-9


def check_inertia(I_xx: float, I_yy: float, I_zz: float) -> list[Finding]:
    r"""Remarks on moments of inertia that no rigid body has.

    They are positive, and none exceeds the sum of the other two, :math:`I_{xx} + I_{yy} \ge I_{zz}`: equality is a flat
    plate. The axes are taken as principal ones.

    Parameters
    ----------
    I_xx, I_yy, I_zz
        kg m².

    Examples
    --------
    The inertia that RotorS gives its iris is that of no body:

    >>> check_inertia(0.03476, 0.04589, 0.0977)[0].message
    'I_zz = 0.0977 kg m^2 exceeds I_xx + I_yy = 0.08065 kg m^2, which no rigid body can have.'
    """
    inertia = {"I_xx": I_xx, "I_yy": I_yy, "I_zz": I_zz}
    wrong = [name for name, value in inertia.items() if not (value > 0.0 and math.isfinite(value))]
    if wrong:
        return [
            _impossible(name, f"{name} = {inertia[name]:.4g} kg m^2 is not positive.", {"kg_m2": inertia[name]})
            for name in wrong
        ]
    findings = []
    for name, value in inertia.items():
        first, second = (other for other in inertia if other != name)
        others = inertia[first] + inertia[second]
        if value > others * (1.0 + _TRIANGLE_ROUNDING):
            message = f"{name} = {value:.4g} kg m^2 exceeds {first} + {second} = {others:.4g} kg m^2, "
            findings.append(
                _impossible(
                    name,
                    message + "which no rigid body can have.",
                    {"kg_m2": value, "sum_of_others_kg_m2": others},
                )
            )
    return findings


def check_hover_speed(physics: Mapping[str, float], *, tolerance: float = 0.05) -> list[Finding]:
    """A remark where the thrust at the stated hover speed is not the weight.

    Parameters
    ----------
    physics
        At least ``m``, ``c_T``, ``rho``, ``D`` and ``n_h``.
    tolerance
        Relative difference of thrust and weight that passes without a remark.

    Examples
    --------
    >>> check_hover_speed({"m": 1.5, "c_T": 0.1, "rho": 1.225, "D": 0.25, "n_h": 70.0})[0].numbers["thrust_per_weight"]
    0.637...
    """
    carried = (physics["n_h"] / hover_speed(physics)) ** 2
    if abs(carried - 1.0) <= tolerance:
        return []
    message = (
        f"At n_h = {physics['n_h']:.4g} rev/s the rotors carry {100.0 * carried:.0f} % of the weight: "
        "m, c_T, rho, D and n_h do not belong to one vehicle in hover."
    )
    return [_impossible("n_h", message, {"thrust_per_weight": carried})]


# Friction opposes motion, and the thrust of a rotor falls with the air that meets it.
_SIGNS = {"c_T": 1.0, "dc_T_dJ": -1.0, "c_H": 1.0, "c_P": 1.0, "m": 1.0, "n_h": 1.0, "k_n": 1.0}


def check_signs(physics: Mapping[str, float]) -> list[Finding]:
    """Remarks on coefficients of a rotor, mass and speeds with a sign that they cannot have.

    Parameters
    ----------
    physics
        Any of ``c_T``, ``dc_T_dJ``, ``c_H``, ``c_P``, ``m``, ``n_h``, ``k_n``; a zero passes.

    Examples
    --------
    >>> check_signs({"c_H": -0.01, "c_T": 0.1})[0].message
    'c_H = -0.01 has the wrong sign: rotor forces alone do not explain it.'
    """
    return [
        _impossible(
            name,
            f"{name} = {physics[name]:.4g} has the wrong sign: rotor forces alone do not explain it.",
            {"value": physics[name]},
        )
        for name, sign in _SIGNS.items()
        if name in physics and sign * physics[name] < 0.0
    ]


def _impossible(where: str, message: str, numbers: Mapping[str, float]) -> Finding:
    return warn("impossible_physics", where, message, **numbers)


# Magnitudes of a small quadrotor; only where the search begins.
_TYPICAL: Mapping[str, float] = {
    "m": 1.0,
    "I_xx": 0.01,
    "I_yy": 0.01,
    "I_zz": 0.02,
    "c_T": 0.1,
    "dc_T_dJ": -0.1,
    "c_H": 0.05,
    "c_P": 0.05,
    "D": 0.2,
    "l": 0.2,
    "z": 0.02,
    "rho": 1.2,
    "k_n": 100.0,
    "n_h": 100.0,
}
# In this order, because the first two follow from the weight without a root.
_BALANCE = ("c_T", "m", "n_h")
_POSITIVE = ("m", "I_xx", "I_yy", "I_zz", "c_T", "D", "l", "rho", "k_n", "n_h")
_EITHER_SIGN = ("z", "c_H", "dc_T_dJ", "c_P")
_STEP = 1e-30
_RANK = 1e-8
_SOLVED = 1e-10
_CONVERGED = 1e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class PhysicalEstimate(Immutable):
    """Physical parameters that explain the derivatives of a hover model.

    Parameters
    ----------
    values
        Every physical parameter, by the names and in the units of ``PHYSICAL_UNITS``; held ones too.
    names
        Those that were estimated, in the order of the covariance.
    covariance
        Of the estimated ones, shape ``(k, k)``.
    misfit
        Of every derivative, in its standard deviations: what the physics says less what was identified. Zero where
        there are just as many derivatives as unknowns.
    findings
        What physics does not allow.
    """

    values: Mapping[str, float]
    names: tuple[str, ...]
    covariance: FloatArray
    misfit: Mapping[str, float]
    findings: tuple[Finding, ...] = field(default=())

    def __post_init__(self) -> None:
        self._set(
            values=self.values,
            covariance=read_only(self.covariance, np.float64, ndim=2),
            misfit=self.misfit,
            findings=tuple(self.findings),
        )

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the estimated parameters."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def from_derivatives(
    derivatives: Mapping[str, float],
    covariance: FloatArray,
    *,
    known: Mapping[str, float],
    known_std: Mapping[str, float] | None = None,
) -> PhysicalEstimate:
    r"""Physical parameters behind the derivatives of a hover model.

    The estimate minimizes :math:`(d(\theta) - \hat d)^T C^{-1} (d(\theta) - \hat d)` with the exact derivatives
    :math:`d(\theta)` of :func:`rotorid.models.physical.hover_derivatives`, and its covariance is
    :math:`(J^T C^{-1} J)^{-1}`, :math:`J = \partial d/\partial\theta`. That the rotors carry the weight in hover is
    kept exactly. A known quantity with a standard deviation counts as one more measurement.

    Assumes that forces of the rotors are all there is. Drag of the body ends up in ``c_H``, a motor lag that was not
    modeled in inertia; where more derivatives are given than needed, ``misfit`` shows it.

    Parameters
    ----------
    derivatives
        Of ``X_u Y_v X_q Y_p M_u L_v M_q L_p L_roll M_pitch N_r N_yaw Z_w Z_thrust`` those that were identified.
    covariance
        Of these, in their order, shape ``(n, n)``.
    known
        Physical parameters that were measured otherwise: mass, geometry, density, ...
    known_std
        Their standard deviations; without one a quantity is held as it is.

    Raises
    ------
    ModelError
        A name is not known, the covariance does not fit, the derivatives do not determine every other quantity (the
        message says which), or no physical parameters come near the derivatives.

    Examples
    --------
    Mass and arm turn thrust and pitch into inertia, :math:`I_{yy} = -m l Z_{thrust} / (2 M_{pitch})`:

    >>> known = dict(I_xx=0.03, I_zz=0.055, dc_T_dJ=-0.13, c_H=0.05, c_P=0.04, z=0.03)
    >>> known |= dict(m=1.5, D=0.25, l=0.25, rho=1.225, k_n=100.0)
    >>> found = from_derivatives({"Z_thrust": -22.4, "M_pitch": 140.0}, np.diag([0.2, 1.4]) ** 2, known=known)
    >>> found.names, round(found.values["I_yy"], 4), round(found.std["I_yy"], 4)
    (('I_yy', 'c_T', 'n_h'), 0.03, 0.0004)
    """
    spread = dict(known_std or {})
    root = _checked(derivatives, covariance, known, spread)
    problem = _Problem(
        targets=dict(derivatives) | {name: known[name] for name in PHYSICAL_UNITS if spread.get(name)},
        root=_joined(root, [spread[name] for name in PHYSICAL_UNITS if spread.get(name)]),
        fixed={name: float(value) for name, value in known.items() if not spread.get(name)},
    )
    start = problem.start()
    problem.require_determined(start, derivatives)
    values = problem.solve(start)
    jacobian = problem.jacobian(values)
    inverse = np.linalg.pinv(jacobian)
    names = tuple(name for name in PHYSICAL_UNITS if name not in problem.fixed)
    spreading = np.array([problem.gradient(values, name) for name in names]).reshape(len(names), -1) @ inverse
    whole = problem.complete(values)
    return PhysicalEstimate(
        values=whole,
        names=names,
        covariance=spreading @ spreading.T,
        misfit=_misfit(whole, derivatives, covariance),
        findings=(
            *check_inertia(whole["I_xx"], whole["I_yy"], whole["I_zz"]),
            *check_signs(whole),
            *check_hover_speed(whole),
            *_contradiction(problem.residual(values), len(problem.free)),
        ),
    )


@dataclass(frozen=True)
class _Problem:
    """Least squares in the physical parameters, the weight carried exactly."""

    targets: Mapping[str, float]
    root: FloatArray  # lower Cholesky factor of the covariance of the targets
    fixed: Mapping[str, float]

    @property
    def dependent(self) -> str | None:
        """The quantity that the weight gives once the others are known."""
        return next((name for name in _BALANCE if name not in self.fixed), None)

    @property
    def free(self) -> tuple[str, ...]:
        return tuple(name for name in PHYSICAL_UNITS if name not in self.fixed and name != self.dependent)

    def complete(self, values: Mapping[str, Number]) -> dict[str, Number]:
        """Every physical parameter from the free ones."""
        known: dict[str, Number] = {**self.fixed, **values}
        if self.dependent == "n_h":
            known["n_h"] = hover_speed(known)
        elif self.dependent is not None:
            product = 4.0 * known["rho"] * known["n_h"] ** 2 * known["D"] ** 4 / STANDARD_GRAVITY_M_S2
            known[self.dependent] = known["m"] / product if self.dependent == "c_T" else known["c_T"] * product
        return {name: known[name] for name in PHYSICAL_UNITS}

    def predicted(self, values: Mapping[str, Number]) -> list[Number]:
        whole = self.complete(values)
        everything = whole | hover_derivatives(whole)
        return [everything[name] for name in self.targets]

    def residual(self, values: Mapping[str, float]) -> FloatArray:
        """Physics less measurement, in independent standard deviations."""
        difference = np.array(self.predicted(values)) - np.array(list(self.targets.values()))
        return np.asarray(np.linalg.solve(self.root, difference))

    def jacobian(self, values: Mapping[str, float]) -> FloatArray:
        """Of the residual, by a complex step, shape ``(targets, free)``."""
        columns = [np.imag(self.predicted(_stepped(values, name))) / _STEP for name in self.free]
        raw = np.array(columns).reshape(len(self.free), len(self.targets)).T
        return np.asarray(np.linalg.solve(self.root, raw))

    def gradient(self, values: Mapping[str, float], name: str) -> FloatArray:
        """Of one physical parameter by the free ones."""
        return np.array([self.complete(_stepped(values, moved))[name].imag / _STEP for moved in self.free])

    def start(self) -> dict[str, float]:
        """Magnitudes that fit: nearly all relations are products, and so straight lines in the logarithms."""
        measured = np.array([np.log(abs(value)) for value in self.targets.values() if value])
        rows = np.array([value != 0.0 for value in self.targets.values()])
        values = self.signs()
        for _ in range(20):
            model = np.array(self.predicted(values))
            step = np.linalg.lstsq(self.elasticity(values)[rows], measured - np.log(np.abs(model[rows])), rcond=_RANK)[
                0
            ]
            step = np.clip(step, -2.0, 2.0)
            values = {name: values[name] * float(np.exp(s)) for name, s in zip(self.free, step, strict=True)}
            if np.abs(step).max(initial=0.0) < _SOLVED:
                break
        return values

    def signs(self) -> dict[str, float]:
        """Typical magnitudes with the signs that agree with most targets; a logarithm cannot find these."""
        typical = {name: _TYPICAL[name] for name in self.free}
        either = [name for name in _EITHER_SIGN if name in self.free]
        wanted = np.sign(list(self.targets.values()))
        tried = [
            typical | {name: sign * typical[name] for name, sign in zip(either, signs, strict=True)}
            for signs in itertools.product((1.0, -1.0), repeat=len(either))
        ]
        return min(tried, key=lambda values: int(np.sum(np.sign(self.predicted(values)) != wanted)))

    def elasticity(self, values: Mapping[str, float]) -> FloatArray:
        """Relative change of every target by that of every free parameter: of pure numbers of order one."""
        raw = self.root @ self.jacobian(values)
        scale = np.array([values[name] for name in self.free])
        return np.asarray(raw * scale / np.array(self.predicted(values))[:, None])

    def require_determined(self, values: Mapping[str, float], derivatives: Iterable[str]) -> None:
        """Refuse a question that the derivatives cannot answer, and name what they leave open."""
        _, singular, right = np.linalg.svd(self.elasticity(values))
        rank = int(np.sum(singular > _RANK * singular.max(initial=1.0)))
        if rank == len(self.free):
            return
        open_ = np.abs(right[rank:]).max(axis=0) > 1e-6
        names = [name for name, left in zip(self.free, open_, strict=True) if left]
        raise ModelError(
            f"{', '.join(derivatives)} and what is known do not determine {', '.join(names)}",
            needed=f"{len(self.free) - rank} more of these quantities or other derivatives",
            remedy=f"give one of {', '.join(names)} as known",
        )

    def solve(self, start: Mapping[str, float]) -> dict[str, float]:
        """The least squares, from magnitudes that fit; signs are free."""
        from scipy.optimize import least_squares

        scale = np.array([start[name] for name in self.free])

        # Derivatives are straight lines in the inverse of inertia, and a step too far cannot lose itself at infinity.
        power = np.array([-1.0 if name.startswith("I_") else 1.0 for name in self.free])

        def values(x: FloatArray) -> dict[str, float]:
            return dict(zip(self.free, (scale * x**power).tolist(), strict=True))

        def residual(x: FloatArray) -> FloatArray:
            return self.residual(values(x))

        def jacobian(x: FloatArray) -> FloatArray:
            return np.asarray(self.jacobian(values(x)) * scale * power * x ** (power - 1.0))

        found = least_squares(
            residual, np.ones(scale.size), jac=jacobian, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
        rest, slopes = residual(found.x), jacobian(found.x)
        # In the units of the covariance: what is left to go is far below one standard deviation.
        left = np.abs(slopes.T @ rest) / np.linalg.norm(slopes, axis=0)
        if not np.all(left <= _CONVERGED * max(float(np.linalg.norm(rest)), 1.0)):
            raise ModelError(
                "no physical parameters come near these derivatives",
                needed="derivatives in SI units, thrust up positive, and forces of rotors alone",
                remedy="leave out the derivatives that other forces rule",
            )
        return values(found.x)


def _stepped(values: Mapping[str, float], name: str) -> dict[str, complex]:
    return {known: complex(value, _STEP * (known == name)) for known, value in values.items()}


def _checked(
    derivatives: Mapping[str, float], covariance: FloatArray, known: Mapping[str, float], spread: Mapping[str, float]
) -> FloatArray:
    """The Cholesky factor of the covariance, once the call is seen to be right."""
    _require_names(derivatives, tuple(hover_derivatives(_TYPICAL)), "derivative")
    _require_names(known, tuple(PHYSICAL_UNITS), "physical parameter")
    _require_names(spread, tuple(known), "known quantity")
    if wrong := [name for name in _POSITIVE if name in known and not 0.0 < known[name] < np.inf]:
        raise ModelError(f"the known {wrong[0]} = {known[wrong[0]]:g} is not possible", needed="a positive number")
    if wrong := [name for name, value in spread.items() if not 0.0 <= value < np.inf]:
        raise ModelError(f"the standard deviation of {wrong[0]} is {spread[wrong[0]]:g}", needed="zero or more")
    if not set(PHYSICAL_UNITS) - {name for name in known if not spread.get(name)}:
        raise ModelError("every physical parameter is given as known", needed="one at least to estimate")
    matrix = np.asarray(covariance, dtype=np.float64)
    if matrix.shape != (len(derivatives), len(derivatives)):
        raise ModelError(
            f"got a covariance of shape {matrix.shape} for {len(derivatives)} derivatives",
            needed=f"shape {(len(derivatives), len(derivatives))}",
        )
    try:
        return np.asarray(np.linalg.cholesky(matrix))
    except np.linalg.LinAlgError:
        raise ModelError(
            "the covariance of the derivatives is not positive definite",
            remedy="leave out derivatives that were fixed or tied in the fit",
        ) from None


def _require_names(names: Iterable[str], allowed: tuple[str, ...], what: str) -> None:
    for name in names:
        if name not in allowed:
            near = nearest_name(name, allowed)
            raise ModelError(
                f"there is no {what} {name!r}",
                needed=f"one of {', '.join(allowed)}",
                remedy=f"did you mean {near}?" if near else "",
            )


def _joined(root: FloatArray, std: list[float]) -> FloatArray:
    size = len(root) + len(std)
    joined = np.diag([*np.diag(root), *std])
    joined[: len(root), : len(root)] = root
    return joined.reshape(size, size)


def _misfit(whole: Mapping[str, float], derivatives: Mapping[str, float], covariance: FloatArray) -> dict[str, float]:
    std = np.sqrt(np.diag(covariance))
    predicted = hover_derivatives(whole)
    return {
        name: (predicted[name] - value) / float(s) for (name, value), s in zip(derivatives.items(), std, strict=True)
    }


def _contradiction(residual: FloatArray, free: int) -> tuple[Finding, ...]:
    """A remark where the physics misses the derivatives by more than chance does in one case of a thousand."""
    from scipy.special import chdtri

    spare = residual.size - free
    missed = float(residual @ residual)
    if spare <= 0 or missed <= chdtri(spare, 0.001):
        return ()
    message = (
        f"No physical parameters explain all derivatives: they miss them by {np.sqrt(missed / spare):.1f} standard "
        "deviations. Other forces than those of the rotors act, or the derivatives are surer on paper than in truth."
    )
    return (warn("impossible_physics", "derivatives", message, chi_square=missed, degrees_of_freedom=spare),)
