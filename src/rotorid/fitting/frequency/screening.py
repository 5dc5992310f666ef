r"""Parameters of a structure that measured responses can show, found before anything is fitted.

A structure holds more than a flight shows. A response that no parameter can produce says nothing to it. A coupling that
none of the usable responses shows is worse: it acts through products with other such couplings alone, a fit drives them
against each other to any size, and takes parameters along that are well seen otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from rotorid.data.trust import EXCELLENT_COST, LOWEST_TOP_RAD_S
from rotorid.errors import ModelError
from rotorid.fitting.frequency.parameter_map import generic_values
from rotorid.fitting.frequency.problem import FrequencyProblem, pair_names
from rotorid.models.parameter import Parameter
from rotorid.models.steady_wind import STEADY_DRAG
from rotorid.models.structure import LinearStructure
from rotorid.typing import BoolArray, FloatArray

_DRAWS = 3
_ZERO = 1e-9
_LEAST_SHOWN = 1e-6
_TRIM = ("U0", "V0", "W0", "phi0", "theta0", *STEADY_DRAG)


def without_structural_zeros(problem: FrequencyProblem) -> tuple[FrequencyProblem, tuple[str, ...]]:
    """The problem without the responses that its structure cannot produce.

    Theta to a yaw command, say, in a model without coupling: the data may show such a response, but no parameter can
    follow it, and its logarithm says nothing. The structure is tried at three sets of generic values of the free
    parameters, from a fixed seed, so that present values of zero do not count as structure; fixed, tied and dropped
    parameters keep to what they are. A response counts as zero where it is below 1e-9 of the geometric mean of the
    largest responses of its output and to its input.

    Parameters
    ----------
    problem
        With all points that the data would allow.

    Returns
    -------
    FrequencyProblem
        With fewer points, or the same problem.
    tuple of str
        Names ``output/input`` of the responses that had points and are taken out.
    """
    silent = problem.used.any(axis=-1) & _zero_everywhere(problem)
    if not silent.any():
        return problem, ()
    names = tuple(name for name, zero in zip(pair_names(problem.data), silent.ravel(), strict=True) if zero)
    return replace(problem, used=problem.used & ~silent[..., None]), names


def _zero_everywhere(problem: FrequencyProblem) -> BoolArray:
    """Responses that are zero at every set of generic values, shape ``(y, u)``; none where no set has a response."""
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    zero = np.ones(problem.used.shape[:2], dtype=np.bool_)
    rng, drawn = np.random.default_rng(0), 0
    for _ in range(_DRAWS):
        theta = generic_values(problem.parameters, rng)
        try:
            response = problem.structure.response(problem.parameters.unpack(theta).values, omega)
        except (ModelError, np.linalg.LinAlgError):
            continue
        zero &= np.abs(response).max(axis=-1, initial=0.0) <= _ZERO * _level(np.abs(response))
        drawn += 1
    return zero & (drawn > 0)


def _level(size: FloatArray) -> FloatArray:
    """How large a response ``(y, u, f)`` might be: the mean of the largest of its output and to its input."""
    largest = size.max(axis=-1, initial=0.0)
    # The root of each, for their product may be too large for a number.
    return np.asarray(np.sqrt(largest.max(axis=0, keepdims=True)) * np.sqrt(largest.max(axis=1, keepdims=True)))


class UnseenCoupling(NamedTuple):
    """A coupling that no usable response shows, and the responses ``output/input`` that would."""

    name: str
    shown_by: tuple[str, ...]


def without_unseen_couplings(problem: FrequencyProblem) -> tuple[FrequencyProblem, tuple[UnseenCoupling, ...]]:
    """The problem with couplings set to zero that its responses cannot show.

    A coupling, see :func:`is_coupling`, stays free if, to first order about the model in hover without any coupling, it
    changes a usable response of an output that shows the equation in which it stands. The first condition leaves out
    what acts through other couplings alone; those that a well-known response shows are no question any more, and the
    model goes on with them. Without the second a weak response of another axis, which has a reason of its own to be
    there, would let couplings grow that hardly touch it. Three sets of generic values are tried.

    Parameters
    ----------
    problem
        With the points that will be fitted.

    Returns
    -------
    FrequencyProblem
        With fewer free parameters, and without responses that are then zero; or the same problem.
    tuple of UnseenCoupling
        What was held at zero.
    """
    couplings = [name for name in problem.parameters.free if is_coupling(problem.structure.parameters[name])]
    if not couplings:
        return problem, ()
    used, known = problem.used.any(axis=-1), _known_well(problem)
    there: set[str] = set()
    while True:
        shown = _shown(problem, couplings, there)
        more = {name for name, would in zip(couplings, shown, strict=True) if (would & known).any()}
        if more <= there:
            break
        there |= more
    names = np.array(pair_names(problem.data)).reshape(used.shape)
    unseen = tuple(
        UnseenCoupling(name, tuple(names[would].tolist()))
        for name, would in zip(couplings, shown, strict=True)
        if not (would & used).any()
    )
    if not unseen:
        return problem, ()
    parameters = problem.parameters
    for coupling in unseen:
        parameters = parameters.drop(coupling.name)
    return without_structural_zeros(problem.with_parameters(parameters))[0], unseen


def without_silent_parameters(problem: FrequencyProblem) -> tuple[FrequencyProblem, tuple[str, ...]]:
    """The problem without parameters that no usable response knows at all, such as damping of an axis not flown.

    Three sets of generic values are tried. A parameter becomes zero where it may be; an essential one stays.

    Parameters
    ----------
    problem
        Without couplings that its responses cannot show.

    Returns
    -------
    FrequencyProblem
        With fewer free parameters, or the same problem.
    tuple of str
        What was held at zero.
    """
    parameters, used = problem.parameters, problem.used.any(axis=-1)
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    silent, drawn = np.ones(len(parameters.free), dtype=np.bool_), 0
    rng = np.random.default_rng(0)
    for _ in range(_DRAWS):
        size = generic_values(parameters, rng)
        try:
            values = parameters.unpack(size).values
            response, slopes = problem.structure.response_and_jacobian(values, omega, parameters.directions)
        except (ModelError, np.linalg.LinAlgError):
            continue
        moved = np.abs(slopes).max(axis=-1, initial=0.0) * np.abs(size)[:, None, None]
        silent &= ~((moved > _ZERO * _level(np.abs(response))) & used).any(axis=(1, 2))
        drawn += 1
    own = [parameters[name] for name, unseen in zip(parameters.free, silent, strict=True) if unseen]
    gone = tuple(one.name for one in own if not one.essential and one.lower <= 0.0 <= one.upper)
    if not (gone and drawn):
        return problem, ()
    for name in gone:
        parameters = parameters.drop(name)
    return without_structural_zeros(problem.with_parameters(parameters))[0], gone


def is_coupling(parameter: Parameter) -> bool:
    """Whether a parameter is zero unless known better: zero in its structure, no time and not essential."""
    zero = parameter.value == 0.0 and parameter.lower <= 0.0 <= parameter.upper
    return zero and parameter.unit != "s" and not parameter.essential


_WELL_KNOWN, _MANY = 0.1, 12


def _known_well(problem: FrequencyProblem) -> BoolArray:
    """Responses that are known to 10 % at a dozen points and more, shape ``(y, u)``."""
    error = np.where(problem.used, problem.data.random_error, np.inf)
    return np.asarray(np.count_nonzero(error <= _WELL_KNOWN, axis=-1) >= _MANY)


def _shown(problem: FrequencyProblem, couplings: Sequence[str], there: Collection[str]) -> BoolArray:
    """Responses that show each coupling to first order, given the others, shape ``(c, y, u)``."""
    parameters = problem.parameters
    structure = problem.structure.with_constants({name: 0.0 for name in _TRIM if name in problem.structure.constants})
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    zero = np.array([name in couplings and name not in there for name in parameters.free])
    rows = [parameters.free.index(name) for name in couplings]
    shown = np.zeros((len(couplings), *problem.used.shape[:2]), dtype=np.bool_)
    rng, drawn = np.random.default_rng(0), 0
    for _ in range(_DRAWS):
        size = generic_values(parameters, rng)
        try:
            values = parameters.unpack(np.where(zero, 0.0, size)).values
            response, slopes = structure.response_and_jacobian(values, omega, parameters.directions)
            equations = _equations(structure, values, parameters.directions)[rows]
        except (ModelError, np.linalg.LinAlgError):
            continue
        moved = np.abs(slopes[rows]).max(axis=-1, initial=0.0) * np.abs(size[rows])[:, None, None]
        shown |= (moved > _LEAST_SHOWN * _level(np.abs(response))) & equations[:, :, None]
        drawn += 1
    # Where the model has no response without couplings, none of them can be judged.
    return shown | (drawn == 0)


def _equations(structure: LinearStructure, values: Mapping[str, float], directions: FloatArray) -> BoolArray:
    """Outputs that show an equation with a free parameter, or are one themselves, shape ``(p, y)``."""
    system, (M, F, G, H0, H1, *_) = structure.matrices_and_jacobian(values, directions)
    stands = (np.abs(M).sum(axis=2) + np.abs(F).sum(axis=2) + np.abs(G).sum(axis=2)) > 0.0
    shows = (np.abs(system.H0) + np.abs(system.H1)) > 0.0
    own = (np.abs(H0).sum(axis=2) + np.abs(H1).sum(axis=2)) > 0.0
    return np.asarray((stands[:, None, :] & shows[None]).any(axis=2) | own)


_EDGE_STEP = 2.0**0.25
_LEAST_SPAN = 4.0
"""Highest over lowest frequency that is left: two octaves, in which a lag and a delay differ."""

_FREE_OF_SPEED_COST = 10.0
"""Speed modes that still bend a response take the damping of a rate model along; they cost more than noise does."""

Fitted = TypeVar("Fitted")


def above_speed_modes(
    problem: FrequencyProblem, fit: Callable[[FrequencyProblem], tuple[Fitted, float]]
) -> Fitted | None:
    """The fit of the widest band that speed modes of an airframe do not bend, or bend least.

    A rate model has no place for the speed of the vehicle, which turns it at low frequencies. Bands that begin higher
    and higher are tried, up to where such modes rule, until one costs no more than noise does.

    Parameters
    ----------
    problem
        With the points that were measured.
    fit
        A fit of part of them, and its average cost; infinite where something else speaks against it.

    Returns
    -------
    Fitted or None
        ``None`` where no band is followed excellently.
    """
    omega = problem.data.omega_rad_s
    used_omega = omega[problem.used.any(axis=(0, 1))]
    low, best, least = float(used_omega[0]) * _EDGE_STEP, None, EXCELLENT_COST
    while least > _FREE_OF_SPEED_COST and low <= min(LOWEST_TOP_RAD_S, float(used_omega[-1]) / _LEAST_SPAN):
        fitted, cost = fit(replace(problem, used=problem.used & (omega >= low)))
        if cost <= least:
            best, least = fitted, cost
        low *= _EDGE_STEP
    return best
