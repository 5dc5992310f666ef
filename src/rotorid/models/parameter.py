"""Parameters: a value is never without its unit, its bounds and its role, alone or tied to others.

Units are products, quotients and powers of SI symbols. A tied parameter is an expression of others; ties are computed
in their order, and directions through them carry errors from free parameters to all.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

import numpy as np

from rotorid.errors import ModelError, UsageError, nearest_name
from rotorid.models.compiled import Operations
from rotorid.models.expression import Expression
from rotorid.typing import FloatArray
from rotorid.units import parse_unit

UNIT_SYMBOLS = ("rad", "m", "s", "kg", "N", "V", "A", "us")
_FACTOR = re.compile(r"([A-Za-z]+)(?:\^(-?[1-9]))?")


@lru_cache(maxsize=1024)
def is_parameter_unit(text: str) -> bool:
    """Whether a text is a product, a quotient or a power of SI symbols, as parameters have them.

    Parameters
    ----------
    text
        Such as ``1/s``, ``rad/s^2``, ``kg m^2`` or ``rad/(m s)``.

    Examples
    --------
    >>> is_parameter_unit("rad/(m s)"), is_parameter_unit("deg/s")
    (True, False)
    """
    above, *below = text.split("/")
    if len(below) > 1:
        return False
    bracketed = below[0].startswith("(") and below[0].endswith(")") if below else False
    under = below[0][1:-1] if bracketed else below[0] if below else ""
    if below and not bracketed and len(under.split(" ")) > 1:
        return False
    return (above == "1" or _is_product(above)) and (not below or _is_product(under))


def _is_product(text: str) -> bool:
    factors = [_FACTOR.fullmatch(factor) for factor in re.split(r"[ *]", text)]
    return all(factor is not None and factor[1] in UNIT_SYMBOLS for factor in factors)


def check_unit(name: str, unit: str) -> None:
    """Refuse a unit that is not SI.

    Parameters
    ----------
    name
        The parameter, for the message.
    unit
        What its unit is said to be.

    Raises
    ------
    ModelError
        The unit is not known, or is not SI.
    """
    if is_parameter_unit(unit):
        return
    try:
        remedy = f"give its numbers in {parse_unit(unit).si}"
    except UsageError:
        remedy = "write powers as s^2, and several factors below in brackets"
    raise ModelError(
        f"the unit of {name} is {unit!r}",
        needed=f"an SI unit made of {', '.join(UNIT_SYMBOLS)} or 1, such as rad/s^2, kg m^2 or rad/(m s)",
        remedy=remedy,
    )


class TieError(ModelError):
    """A tie that cannot stand; ``parameter`` is the one whose tie it is."""

    def __init__(self, parameter: str, came: str, *, needed: str = "", remedy: str = "") -> None:
        super().__init__(came, needed=needed, remedy=remedy)
        self.parameter = parameter


class Network:
    """Which parameters are free and which are computed, for one set of names. It holds no values.

    Parameters
    ----------
    names
        Every parameter, in order.
    free
        Slots of the free ones.
    tied
        Expressions of the computed ones, by their names.
    constants
        Numbers that ties may name besides parameters.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        free: Sequence[int],
        tied: Mapping[str, Expression],
        constants: Mapping[str, float],
    ) -> None:
        self.names = names
        self.free = tuple(free)
        plain = {name: expression.substitute(constants) for name, expression in tied.items()}
        self.ties = {name: plain[name] for name in _in_order(names, plain)}
        self._slots = [names.index(name) for name in self.ties]
        self._values = Operations(list(self.ties.values()), names, self.ties)

    def resolve(self, numbers: list[float]) -> None:
        """Compute the tied values in place.

        Raises
        ------
        ModelError
            A tie has no finite value there.
        """
        if not self._slots:
            return
        try:
            results = self._values(numbers)
        except (ArithmeticError, ValueError):
            self._blame(numbers)
            raise
        for slot, value in zip(self._slots, results, strict=True):
            numbers[slot] = value

    def _blame(self, numbers: Sequence[float]) -> None:
        """Say which tie has no value: slow, and only on the way to an error."""
        values = dict(zip(self.names, numbers, strict=True))
        for name, expression in self.ties.items():
            try:
                values[name] = expression.evaluate(values)
            except ModelError as error:
                raise TieError(name, f"{name} is tied, and {error.came}", needed=error.needed) from None

    def directions(self, numbers: Sequence[float]) -> FloatArray:
        """How every value moves with the free ones, shape ``(parameters, free)``, read-only.

        Raises
        ------
        ModelError
            A tie has no finite derivative there.
        """
        return self._constant_directions if self._is_affine else self._directions(numbers)

    @cached_property
    def _is_affine(self) -> bool:
        return all(expression.as_affine() is not None for expression in self.ties.values())

    @cached_property
    def _constant_directions(self) -> FloatArray:
        return self._directions([0.0] * len(self.names))

    @cached_property
    def _sources(self) -> list[tuple[int, list[int], slice]]:
        """For each tie its slot, those of its sources, and where its slopes stand in the list of all."""
        counts = [len(expression.names) for expression in self.ties.values()]
        ends = np.cumsum([0, *counts]).tolist()
        sources = [[self.names.index(name) for name in sorted(e.names)] for e in self.ties.values()]
        return [(slot, s, slice(a, b)) for slot, s, a, b in zip(self._slots, sources, ends, ends[1:], strict=False)]

    @cached_property
    def _slopes(self) -> Operations:
        slopes = [e.derivative(name) for e in self.ties.values() for name in sorted(e.names)]
        return Operations(slopes, self.names)

    def _directions(self, numbers: Sequence[float]) -> FloatArray:
        directions = np.zeros((len(self.names), len(self.free)))
        directions[list(self.free), range(len(self.free))] = 1.0
        slopes = self._gradients(numbers)
        for slot, sources, where in self._sources:
            directions[slot] = slopes[where] @ directions[sources]
        directions.setflags(write=False)
        return directions

    def _gradients(self, numbers: Sequence[float]) -> FloatArray:
        try:
            slopes = np.array(self._slopes(numbers), dtype=np.float64)
        except (ArithmeticError, ValueError):
            slopes = np.array([np.nan])
        if not np.isfinite(slopes).all():
            values = dict(zip(self.names, numbers, strict=True))
            for name, expression in self.ties.items():
                for source in sorted(expression.names):
                    try:
                        expression.derivative(source).evaluate(values)
                    except ModelError as error:
                        came = f"{name} is tied and has no derivative with respect to {source}: {error.came}"
                        raise TieError(name, came, needed=error.needed) from None
        return slopes


def no_such(kind: str, name: str, known: Iterable[str]) -> ModelError:
    """The error for a name that does not exist, with the nearest one that does."""
    names = tuple(known)
    near = nearest_name(name, names) or next((other for other in names if name and other.startswith(name)), "")
    return ModelError(
        f"there is no {kind} {name!r}",
        needed=f"one of {', '.join(names)}" if names else f"no {kind} at all",
        remedy=f"did you mean {near}?" if near else "",
    )


def changed_constants(known: Mapping[str, float], changes: Mapping[str, float]) -> dict[str, float]:
    """Constants of a structure, some with other values.

    Raises
    ------
    ModelError
        There is no such constant.
    """
    for name in changes:
        if name not in known:
            raise no_such("constant", name, known)
    return {**known, **changes}


def _in_order(names: tuple[str, ...], tied: Mapping[str, Expression]) -> list[str]:
    """The tied parameters, each after those it is tied to."""
    needed = {name: sorted(expression.names) for name, expression in tied.items()}
    for name, sources in needed.items():
        for source in sources:
            if source not in names:
                unknown = no_such("parameter", source, names)
                came = f"{name} is tied to {source!r}, which is no parameter"
                raise TieError(name, came, needed=unknown.needed, remedy=unknown.remedy)
    done: list[str] = []
    for start in needed:
        path, pending = [start], [iter(needed[start])]
        while pending and start not in done:
            source = next(pending[-1], "")
            if not source:
                done.append(path.pop())
                pending.pop()
            elif source in path:
                loop = " -> ".join([*path[path.index(source) :], source])
                raise TieError(source, f"the ties go in a loop: {loop}", remedy="free or fix one of them")
            elif source in needed and source not in done:
                path.append(source)
                pending.append(iter(needed[source]))
    return done


Status: TypeAlias = Literal["free", "fixed", "tied", "dropped"]

_SAME = 1e-9


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameter:
    """One number of a model.

    Parameters
    ----------
    name
        Symbol of the field: ``L_p``, ``M_pitch``, ``tau_roll``, ``T_motor``.
    value
        In ``unit``. That of a tied parameter is computed by its set.
    unit
        SI unit, such as ``rad/s^2``, ``kg m^2`` or ``rad/(m s)``.
    lower, upper
        Bounds that a fit respects.
    status
        ``free`` to be identified, ``fixed`` by the user, ``tied`` to others, ``dropped`` from the structure (its value
        is then zero).
    starts
        Values from which a search without a better idea begins.
    tied
        What the value is of other parameters; given if and only if the status is ``tied``.
    essential
        Physics that a reduction never drops silently.

    Raises
    ------
    ModelError
        The unit is not SI, the value lies outside its bounds, or tie and status contradict each other.
    """

    name: str
    value: float = 0.0
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    status: Status = "free"
    starts: tuple[float, ...] = ()
    tied: Expression | None = None
    essential: bool = False

    def __post_init__(self) -> None:
        if self.tied is not None and self.status == "free":
            object.__setattr__(self, "status", "tied")
        if (self.tied is not None) != (self.status == "tied"):
            came = f"{self.name} is {self.status} and {'not ' if self.tied is None else ''}tied to an expression"
            raise ModelError(came, needed="an expression for the status tied, and for no other")
        check_unit(self.name, self.unit)
        if not self.lower <= self.upper:
            raise ModelError(
                f"the bounds of {self.name} go from {self.lower:g} to {self.upper:g}",
                needed="a lower bound below the upper one",
            )
        if self.tied is None and not (self.lower <= self.value <= self.upper and np.isfinite(self.value)):
            raise self.out_of_bounds(self.value)

    def out_of_bounds(self, value: float) -> ModelError:
        """The error for a value that this parameter cannot have."""
        computed = f" (tied to {self.tied})" if self.tied is not None else ""
        return ModelError(
            f"{self.name} = {value:g} {self.unit}{computed} lies outside its bounds",
            needed=f"a finite value from {self.lower:g} to {self.upper:g}",
        )


class _Layout:
    """What a set of parameters keeps while its values move."""

    def __init__(self, parameters: tuple[Parameter, ...], constants: Mapping[str, float]) -> None:
        self.parameters = parameters
        self.constants = MappingProxyType(dict(constants))
        self.names = tuple(parameter.name for parameter in parameters)
        self.slots = {name: slot for slot, name in enumerate(self.names)}
        if len(self.slots) != len(parameters):
            twice = sorted({name for name in self.names if self.names.count(name) > 1})
            raise ModelError(f"two parameters have one name, {', '.join(twice)}", needed="every name once")
        tied = {p.name: p.tied for p in parameters if p.tied is not None}
        free = [slot for slot, p in enumerate(parameters) if p.status == "free"]
        self.network = Network(self.names, free, tied, constants)
        self.free = tuple(self.names[slot] for slot in free)
        # The largest finite numbers stand for no bound, so that one comparison also catches what is not finite.
        largest = float(np.finfo(np.float64).max)
        self.limits = tuple((max(p.lower, -largest), min(p.upper, largest)) for p in parameters)

    def check(self, numbers: list[float]) -> None:
        """Refuse a value outside its bounds."""
        inside = [low <= number <= high for number, (low, high) in zip(numbers, self.limits, strict=True)]
        if not all(inside):
            slot = inside.index(False)
            raise self.parameters[slot].out_of_bounds(numbers[slot])


class ParameterSet:
    """Parameters of one model, in order. Every change gives a new set.

    Parameters
    ----------
    parameters
        The parameters; the values of tied ones are computed here.
    constants
        Numbers that are no parameters and that ties may name, such as gravity; sets are equal whatever theirs are.

    Raises
    ------
    ModelError
        A name stands twice, a tie names no parameter or goes in a loop, or a value lies outside its bounds.

    Examples
    --------
    >>> symmetric = ParameterSet((Parameter(name="L_p", value=-2.0, unit="1/s"),
    ...                           Parameter(name="M_q", unit="1/s", tied=Expression.parse("L_p"))))
    >>> symmetric.unpack(np.array([-3.0])).values
    {'L_p': -3.0, 'M_q': -3.0}
    """

    def __init__(self, parameters: Iterable[Parameter], constants: Mapping[str, float] | None = None) -> None:
        given = tuple(parameters)
        self._layout = _Layout(given, constants or {})
        self._numbers = [float(parameter.value) for parameter in given]
        self._settle()

    def _settle(self) -> None:
        self._layout.network.resolve(self._numbers)
        self._layout.check(self._numbers)

    def _moved(self, numbers: list[float]) -> ParameterSet:
        """The same set with other numbers. A fit does this at every evaluation, so nothing else is built anew."""
        moved: ParameterSet = object.__new__(ParameterSet)
        moved._layout, moved._numbers = self._layout, numbers
        moved._settle()
        return moved

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        pairs = zip(self._layout.parameters, self._numbers, strict=True)
        return tuple(p if p.value == value else replace(p, value=value) for p, value in pairs)

    def __reduce__(self) -> tuple[Any, ...]:
        return ParameterSet, (self.parameters, dict(self.constants))

    def __eq__(self, other: object) -> bool:
        return self.parameters == other.parameters if isinstance(other, ParameterSet) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.parameters)

    def __repr__(self) -> str:
        return f"ParameterSet({self.parameters!r})"

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, name: str) -> Parameter:
        return self.parameters[self._slot(name)]

    def _slot(self, name: str) -> int:
        if name not in self._layout.slots:
            raise no_such("parameter", name, self.names)
        return self._layout.slots[name]

    @property
    def names(self) -> tuple[str, ...]:
        return self._layout.names

    @property
    def constants(self) -> Mapping[str, float]:
        """Numbers that ties may name besides parameters."""
        return self._layout.constants

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that a fit may move."""
        return self._layout.free

    @property
    def values(self) -> dict[str, float]:
        """Every value by its name, ties resolved."""
        return dict(zip(self._layout.names, self._numbers, strict=True))

    @property
    def directions(self) -> FloatArray:
        """Exact derivative of every value with respect to the free ones, shape ``(parameters, free)``.

        Ties follow the chain rule, at the present values.
        """
        return self._layout.network.directions(self._numbers)

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the free parameters, each shape ``(n,)``."""
        free = [self[name] for name in self.free]
        return np.array([parameter.lower for parameter in free]), np.array([parameter.upper for parameter in free])

    def pack(self) -> FloatArray:
        """Values of the free parameters, shape ``(n,)``."""
        return np.array([self._numbers[slot] for slot in self._layout.network.free])

    def unpack(self, theta: FloatArray) -> ParameterSet:
        """The same set with new values of the free parameters.

        Raises
        ------
        ModelError
            A value, computed ones included, is not finite or lies outside its bounds.
        """
        numbers = self._numbers.copy()
        for slot, value in zip(self._layout.network.free, np.asarray(theta).tolist(), strict=True):
            numbers[slot] = value
        return self._moved(numbers)

    def with_values(self, values: Mapping[str, float]) -> ParameterSet:
        """The same set with some values changed.

        Raises
        ------
        ModelError
            A name is unknown, a value lies outside its bounds, or a tied parameter was given another than its tie.
        """
        numbers = self._numbers.copy()
        for name, value in values.items():
            numbers[self._slot(name)] = float(value)
        moved = self._moved(numbers)
        for name in values.keys() & self._layout.network.ties.keys():
            given, computed = values[name], moved._numbers[self._slot(name)]
            if not abs(given - computed) <= _SAME * abs(computed):
                raise ModelError(
                    f"{name} = {given:g} was given and its tie {self[name].tied} is {computed:g}",
                    needed="values for what is not tied",
                    remedy="free or fix it first",
                )
        return moved

    def fix(self, name: str, value: float) -> ParameterSet:
        """The same set with one parameter held at ``value``."""
        return self._with(name, value=value, status="fixed", tied=None)

    def drop(self, name: str) -> ParameterSet:
        """The same set without the effect of one parameter."""
        return self._with(name, value=0.0, status="dropped", tied=None)

    def tie(self, name: str, expression: str | float | Expression) -> ParameterSet:
        """The same set with one parameter computed from others.

        Parameters
        ----------
        name
            The parameter to compute.
        expression
            What it is of the others, such as ``-L_p`` or ``T_front + 0.01``.

        Raises
        ------
        ModelError
            The expression cannot be read, names no parameter, or closes a loop.
        """
        tied = expression if isinstance(expression, Expression) else Expression.parse(expression)
        return self._with(name, status="tied", tied=tied)

    def free_again(self, name: str) -> ParameterSet:
        """The same set with one parameter free from its present value on: a fix, drop or tie undone."""
        return self._with(name, status="free", tied=None)

    def only(self, names: Iterable[str]) -> ParameterSet:
        """The set of some parameters and of those that they are tied to, in the present order.

        Raises
        ------
        ModelError
            A name is unknown.
        """
        kept: set[str] = set()
        waiting = list(names)
        while waiting:
            name = waiting.pop()
            if name not in kept:
                kept.add(name)
                tied = self[name].tied
                waiting += sorted(tied.names - self.constants.keys()) if tied is not None else []
        return ParameterSet((parameter for parameter in self.parameters if parameter.name in kept), self.constants)

    def with_constants(self, constants: Mapping[str, float]) -> ParameterSet:
        """The same set with other numbers for its ties to name."""
        return ParameterSet(self.parameters, constants)

    def _with(self, name: str, **change: Any) -> ParameterSet:
        changed = replace(self[name], **change)
        return ParameterSet((changed if p.name == name else p for p in self.parameters), self.constants)
