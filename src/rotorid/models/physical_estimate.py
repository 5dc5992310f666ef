"""From derivatives back to mass, inertia and rotors, with the uncertainty that comes along."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import ModelError
from rotorid.models.physical import PHYSICAL_UNITS, Number, hover_derivatives, hover_speed
from rotorid.models.physical_checks import check_hover_speed, check_inertia, check_signs
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

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
_ROUNDING = 1e-10
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
        held={name: float(value) for name, value in known.items() if not spread.get(name)},
    )
    start = problem.start()
    problem.require_determined(start, derivatives)
    values = problem.solve(start)
    jacobian = problem.jacobian(values)
    inverse = np.linalg.pinv(jacobian)
    names = tuple(name for name in PHYSICAL_UNITS if name not in problem.held)
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
    held: Mapping[str, float]

    @property
    def dependent(self) -> str | None:
        """The quantity that the weight gives once the others are known."""
        return next((name for name in _BALANCE if name not in self.held), None)

    @property
    def free(self) -> tuple[str, ...]:
        return tuple(name for name in PHYSICAL_UNITS if name not in self.held and name != self.dependent)

    def complete(self, values: Mapping[str, Number]) -> dict[str, Number]:
        """Every physical parameter from the free ones."""
        known: dict[str, Number] = {**self.held, **values}
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
        return np.array([self.complete(_stepped(values, one))[name].imag / _STEP for one in self.free])

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
            if np.abs(step).max(initial=0.0) < _ROUNDING:
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
    return {one: complex(value, _STEP * (one == name)) for one, value in values.items()}


def _checked(
    derivatives: Mapping[str, float], covariance: FloatArray, known: Mapping[str, float], spread: Mapping[str, float]
) -> FloatArray:
    """The Cholesky factor of the covariance, once the call is seen to be right."""
    _require_names(derivatives, tuple(hover_derivatives(_TYPICAL)), "derivative")
    _require_names(known, tuple(PHYSICAL_UNITS), "physical parameter")
    _require_names(spread, tuple(known), "known quantity")
    if wrong := [name for name in _POSITIVE if name in known and not 0.0 < known[name] < np.inf]:
        raise ModelError(f"{wrong[0]} = {known[wrong[0]]:g} came as known", needed="a positive number")
    if wrong := [name for name, value in spread.items() if not 0.0 <= value < np.inf]:
        raise ModelError(f"the standard deviation of {wrong[0]} is {spread[wrong[0]]:g}", needed="zero or more")
    if not set(PHYSICAL_UNITS) - {name for name in known if not spread.get(name)}:
        raise ModelError("every physical parameter came as known", needed="one at least to estimate")
    matrix = np.asarray(covariance, dtype=np.float64)
    if matrix.shape != (len(derivatives), len(derivatives)):
        raise ModelError(
            f"a covariance of shape {matrix.shape} came for {len(derivatives)} derivatives",
            needed=f"shape {(len(derivatives), len(derivatives))}",
        )
    try:
        return np.asarray(np.linalg.cholesky(matrix))
    except np.linalg.LinAlgError:
        raise ModelError(
            "the covariance of the derivatives is not positive definite",
            remedy="leave out derivatives that were held or tied in the fit",
        ) from None


def _require_names(names: Iterable[str], allowed: tuple[str, ...], what: str) -> None:
    for name in names:
        if name not in allowed:
            near = difflib.get_close_matches(name, allowed, n=1)
            raise ModelError(
                f"there is no {what} {name!r}",
                needed=f"one of {', '.join(allowed)}",
                remedy=f"did you mean {near[0]}?" if near else "",
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
    return (
        Finding(
            kind="impossible_physics",
            severity="warning",
            where="derivatives",
            message=message,
            numbers={"chi_square": missed, "degrees_of_freedom": spare},
        ),
    )
