r"""Which combinations of parameters the data see, and which they do not.

Relative changes :math:`\delta \ln \theta` that leave the response as it is span the null space of the scaled
sensitivities :math:`J \, \mathrm{diag}(\theta)`; it shows as directions of very large relative covariance. A product
of powers :math:`\prod \theta_i^{e_i}` is seen if :math:`e` is orthogonal to that space, a sum
:math:`\sum e_i \theta_i` if it is so without the scaling. Small whole exponents are tried, the simplest first. What is
found holds near the identified values; for true products and sums it holds everywhere.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.models.parameter import ParameterSet
from rotorid.typing import FloatArray, IntArray
from rotorid.uncertainty.cramer_rao import Bounds

_UNSEEN = 0.5
_PART = 0.3
_COUPLED = 0.05
# No data determine a parameter to a hundred times its value: only a flat cost does.
_FLAT = 100.0
_FLAT_PART = 1e-3
_SEEN_NEAR, _SEEN_FLAT = 0.15, 1e-3
_LARGEST_POWER = 3
_LARGEST_GROUP = 6

_MEASUREMENTS: Mapping[str, str] = {
    "kg": "by weighing",
    "m": "with a ruler",
    "kg m^2": "by swinging the vehicle on two cords",
    **dict.fromkeys(("N", "N/V", "N/us", "N s/rad", "N m", "N m/V", "N m/us", "N m s/rad"), "on a thrust stand"),
}
"""How a parameter of a unit is measured on the ground, easiest first."""

_NOT_LENGTHS: Mapping[str, str] = {"kappa": "N m"}
"""Parameters whose unit misleads: torque over thrust has that of a length."""

_NUMBERS = ("none", "one", "two", "three", "four", "five")


@dataclass(frozen=True, kw_only=True)
class Combination(Immutable):
    """A direction in which the parameters can move with barely a change of the response.

    Parameters
    ----------
    vector
        Parameter to its share, in relative changes; a unit vector. The worst one where there are several.
    relative_std
        One standard deviation along it, relative to the values.
    names
        Parameters that cannot be separated; read from the vector if empty.
    seen
        Products or sums of them that the data do see, with their values: ``K_f/J_x = 2.32``.
    what_to_do
        What to give or to measure.
    """

    vector: Mapping[str, float]
    relative_std: float
    names: tuple[str, ...] = ()
    seen: tuple[str, ...] = ()
    what_to_do: str = "Fix one of them, or excite a wider band"

    def __post_init__(self) -> None:
        self._set(vector=self.vector)

    @property
    def flat(self) -> bool:
        """The response does not change at all along the direction."""
        return self.relative_std > _FLAT

    def words(self) -> str:
        """The identifiable combination and the remedy, in words."""
        parts = self.names or self._parts()
        # Beyond a factor of ten the number says nothing more.
        percent = f"{100.0 * min(self.relative_std, 10.0):.0f} %"
        if len(parts) < 2:
            return f"{parts[0]} is very uncertain (±{percent})."
        if not self.seen:
            return (
                f"{listed(parts)} can barely be separated: together they may change by {percent} without "
                f"changing the response. {self.what_to_do}."
            )
        verb = "is" if len(self.seen) == 1 else "are"
        if self.flat:
            return f"The data show only {listed(self.seen)}, so {listed(parts)} cannot be separated. {self.what_to_do}."
        return (
            f"{listed(parts)} can barely be separated: each is uncertain by {percent}, although "
            f"{listed(self.seen)} {verb} well known. {self.what_to_do}."
        )

    def _parts(self) -> tuple[str, ...]:
        # Among very many parameters even the largest share may be small.
        least = min(_PART, 0.8 * max(abs(share) for share in self.vector.values()))
        return tuple(name for name, share in self.vector.items() if abs(share) >= least)


def unseen_combinations(parameters: ParameterSet, bounds: Bounds) -> tuple[Combination, ...]:
    """Groups of parameters with a direction whose relative standard deviation is above one half, worst first.

    Parameters at zero are left out: relative changes of them mean nothing.

    Parameters
    ----------
    parameters
        As identified.
    bounds
        Of the same solution.
    """
    values = np.array([parameters[name].value for name in bounds.names])
    kept = np.flatnonzero(np.abs(values) > 0.0)
    if kept.size == 0:
        return ()
    relative = bounds.covariance[np.ix_(kept, kept)] / np.outer(values[kept], values[kept])
    free = tuple(bounds.names[index] for index in kept)
    found: list[Combination] = []
    rest = list(range(len(free)))
    # Flat directions first and apart: they are exact, and would drown the weak ones.
    for flat in (True, False):
        variances, vectors = np.linalg.eigh(relative[np.ix_(rest, rest)])
        null = vectors[:, variances > (_FLAT if flat else _UNSEEN) ** 2]
        groups = [[rest[i] for i in group] for group in _groups(null, flat=flat)]
        for group in groups:
            found += _explain(parameters, free, relative, group, flat=flat)
        rest = [i for i in rest if not any(i in group for group in groups)]
    return tuple(sorted(found, key=lambda combination: -combination.relative_std))


def _groups(null: FloatArray, *, flat: bool) -> list[list[int]]:
    """Parameters that a null space couples, as lists of indices."""
    projector = null @ null.T
    share = np.sqrt(np.diag(projector))
    least = _FLAT_PART if flat else min(_PART, 0.8 * float(share.max(initial=0.0)))
    waiting = [int(i) for i in np.flatnonzero((share >= least) & (share > 0.0))]
    groups = []
    while waiting:
        group = [waiting.pop(0)]
        for member in group:
            bound = _COUPLED * share[member] * share
            joined = [i for i in waiting if abs(projector[member, i]) > bound[i]]
            waiting = [i for i in waiting if i not in joined]
            group += joined
        groups.append(sorted(group))
    return groups


def _explain(
    parameters: ParameterSet, free: tuple[str, ...], relative: FloatArray, group: list[int], *, flat: bool
) -> list[Combination]:
    """One combination for a group with identifiable products or sums, else one for each direction."""
    least = _FLAT if flat else _UNSEEN
    for members in _with_other_times(parameters, free, group):
        names = tuple(free[i] for i in members)
        variances, vectors = np.linalg.eigh(relative[np.ix_(members, members)])
        unseen = max(1, int(np.sum(variances > least**2)))
        products = _determined_terms(parameters, names, variances, vectors, len(members) - unseen, flat=flat)
        if products:
            break
    shares = [dict.fromkeys(free, 0.0) | dict(zip(names, map(float, v), strict=True)) for v in vectors.T[::-1]]
    stds = np.sqrt(np.maximum(variances[::-1], 0.0))
    if products:
        advice = _advice(parameters, names, vectors[:, -unseen:], flat=flat)
        worst = Combination(
            vector=shares[0], relative_std=float(stds[0]), names=names, seen=products, what_to_do=advice
        )
        return [worst]
    if flat and unseen == 1 and len(names) > 1:
        # No band separates parameters that act exactly as one; the shares would hide the small parts of it.
        advice = _advice(parameters, names, vectors[:, -1:], flat=flat)
        return [Combination(vector=shares[0], relative_std=float(stds[0]), names=names, what_to_do=advice)]
    return [Combination(vector=shares[i], relative_std=float(stds[i])) for i in range(unseen)]


def _with_other_times(parameters: ParameterSet, free: tuple[str, ...], group: list[int]) -> list[list[int]]:
    """The group, after the same with every other time: of a short delay and a long lag only one may seem unseen."""
    times = [i for i, name in enumerate(free) if parameters[name].unit == "s"]
    if set(group) < set(times):
        return [*([extended for extended in (sorted({*group, i}) for i in times) if extended != group]), group]
    return [group]


def _determined_terms(
    parameters: ParameterSet,
    names: tuple[str, ...],
    variances: FloatArray,
    vectors: FloatArray,
    count: int,
    *,
    flat: bool,
) -> tuple[str, ...]:
    """Texts of ``count`` identifiable products or sums of a group; empty if there are no simple ones."""
    values = np.array([parameters[name].value for name in names])
    root = vectors * np.sqrt(np.maximum(variances, 0.0))
    units = {parameters[name].unit for name in names}
    tolerance = _SEEN_FLAT if flat else _SEEN_NEAR
    products = () if units == {"s"} else _integer_rows(root, count, tolerance)
    if len(products):
        heavy = [parameters[name].unit.startswith("kg") for name in names]
        return tuple(_product(names, values, _turned(row, heavy)) for row in products)
    # Sums of unlike things have no meaning.
    sums = _integer_rows(values[:, None] * root, count, tolerance) if len(units) == 1 else ()
    return tuple(_sum(names, values, row) for row in sums)


def _integer_rows(root: FloatArray, count: int, tolerance: float) -> Sequence[IntArray]:
    """The simplest ``count`` independent whole-number rows that a covariance ``root @ root.T`` barely moves."""
    size = len(root)
    if count < 1 or size > _LARGEST_GROUP:
        return ()
    powers = range(-_LARGEST_POWER, _LARGEST_POWER + 1)
    rows = np.array(list(itertools.product(powers, repeat=size)))
    rows = rows[np.any(rows != 0, axis=1)]
    spread = np.sqrt(np.sum((rows @ root) ** 2, axis=1) / np.sum(rows**2, axis=1))
    alone = np.sqrt(np.sum(root**2, axis=1))
    # Signs aside, the rows come in pairs; the one that begins positive is kept.
    leading = rows[np.arange(len(rows)), np.argmax(rows != 0, axis=1)] > 0
    rows = rows[leading & (spread <= tolerance * alone.min())]
    order = np.lexsort((np.sum(rows < 0, axis=1), np.abs(rows).max(axis=1, initial=0), np.abs(rows).sum(axis=1)))
    found: list[IntArray] = []
    for row in rows[order]:
        if np.linalg.matrix_rank(np.array([*found, row])) > len(found):
            found.append(row)
        if len(found) == count:
            return found
    return ()


def _turned(row: IntArray, heavy: Sequence[bool]) -> IntArray:
    """Exponents with inertia below the line, where physics writes it, but never all of them there."""
    weight = int(np.sum(row[np.array(heavy)]))
    above_only = bool(np.all(row >= 0))
    return -row if np.all(row <= 0) or (weight > 0 and not above_only) else row


def _product(names: tuple[str, ...], values: FloatArray, powers: IntArray) -> str:
    def factors(sign: int) -> list[str]:
        chosen = [(name, sign * int(power)) for name, power in zip(names, powers, strict=True) if sign * power > 0]
        return [name if power == 1 else f"{name}**{power}" for name, power in chosen]

    above, below = factors(1), factors(-1)
    text = "*".join(above) or "1"
    if below:
        text += "/" + (below[0] if len(below) == 1 else f"({'*'.join(below)})")
    return f"{text} = {float(np.prod(values**powers)):.4g}"


def _sum(names: tuple[str, ...], values: FloatArray, factors: IntArray) -> str:
    terms = [
        f"{'-' if factor < 0 else '+'} {'' if abs(factor) == 1 else f'{abs(factor)}*'}{name}"
        for name, factor in zip(names, factors, strict=True)
        if factor
    ]
    return f"{' '.join(terms).removeprefix('+ ')} = {float(factors @ values):.4g}"


def _advice(parameters: ParameterSet, names: tuple[str, ...], null: FloatArray, *, flat: bool) -> str:
    """Parameters to give so that the others follow, and how to measure them."""
    count = null.shape[1]
    units = [_NOT_LENGTHS.get(name, parameters[name].unit) for name in names]
    easiest = list(_MEASUREMENTS)
    effort = [easiest.index(unit) if unit in easiest else len(easiest) for unit in units]
    subsets = list(itertools.combinations(range(len(names)), count))
    # Given parameters determine the others only if every unobservable direction changes one of them.
    settled = [subset for subset in subsets if abs(np.linalg.det(null[list(subset)])) > _COUPLED**count]
    best = min(settled or subsets, key=lambda subset: sum(effort[i] for i in subset))
    chosen = tuple(names[i] for i in best)
    number = _NUMBERS[count] if count < len(_NUMBERS) else str(count)
    among = f"{number} of them" if len(names) == 2 else f"{number} of {', '.join(names)}"
    options = " ".join(f"--fix {name}=VALUE" for name in chosen)
    text = f"Give {among} ({options})" if len(settled) == len(subsets) else f"Give {listed(chosen)} ({options})"
    ways = [f"{names[i]} can be measured {_MEASUREMENTS[units[i]]}" for i in best if units[i] in _MEASUREMENTS]
    if set(units) == {"s"}:
        ways = ["a signal logged between them, such as the motor speeds, separates them"]
        ways += [] if flat else ["so does a wider band"]
    elif not flat:
        ways = [*ways, "a wider band may separate them"]
    return f"{text}; {' and '.join(ways)}" if ways else text
