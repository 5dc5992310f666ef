r"""Black-box state spaces of any order, as sections side by side, two modes in each.

.. math:: \dot x_k = \begin{bmatrix} 0 & 1 \\ -a_{0,k} & -a_{1,k} \end{bmatrix} x_k + B_k u(t - \tau), \qquad
    y = \sum_k C_k x_k

with one row of every :math:`C_k` held at :math:`[1, 0]`. A section has two poles, real or complex alike, so that a fit
may pass from one to the other; an odd order adds one section :math:`\dot x = -a_0 x + b u`. Per second-order section
there are two poles, 2u gains and 2 (y - 1) weights: just as many numbers as the data can identify in a minimal model;
free A, B, C would have n² more and no finite bounds. Any system whose modes can be separated takes this form
(:func:`modal_parts`, :func:`from_state_space`); two sections with the same two poles cannot be separated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.equations import structure_from_equations
from rotorid.models.parameter import Parameter, ParameterSet, no_such
from rotorid.models.structure import LinearStructure
from rotorid.typing import ComplexArray, FloatArray

_SAME_POLE = 1e-7


class Part(NamedTuple):
    """The share of a system that one section has, in any coordinates."""

    A: FloatArray
    B: FloatArray
    C: FloatArray


def modal_parts(A: FloatArray, B: FloatArray, C: FloatArray) -> list[Part]:
    """A system split into sections of two modes, slowest first, and one of a single mode last where the order is odd.

    Complex pairs make a section each; real poles are paired with their neighbors.

    Parameters
    ----------
    A, B, C
        Shapes ``(x, x)``, ``(x, u)`` and ``(y, x)``.

    Raises
    ------
    ModelError
        One pole is in two sections: they cannot be split.

    Examples
    --------
    >>> parts = modal_parts(np.diag([-9.0, -1.0, -8.0, -1.1]), np.ones((4, 1)), np.ones((1, 4)))
    >>> [np.sort(np.linalg.eigvals(part.A)).round(9).tolist() for part in parts]
    [[-1.1, -1.0], [-9.0, -8.0]]
    """
    poles = np.linalg.eigvals(A).astype(np.complex128)
    groups = _groups(poles)
    if len(groups) == 1:
        return [Part(A, B, C)]
    _check_distinct(poles, groups)
    basis = np.hstack([_invariant(A, poles, group) for group in groups])
    inverse = np.linalg.inv(basis)
    A, B, C = inverse @ A @ basis, inverse @ B, C @ basis
    ends = np.cumsum([len(group) for group in groups])
    slots = [slice(end - len(group), end) for end, group in zip(ends, groups, strict=True)]
    return [Part(A[slot, slot], B[slot], C[:, slot]) for slot in slots]


def _invariant(A: FloatArray, poles: ComplexArray, group: Sequence[int]) -> FloatArray:
    """An orthonormal basis of the subspace that belongs to some poles, defective or not."""
    from scipy.linalg import schur

    def inside(real: float, imaginary: float) -> bool:
        return int(np.argmin(np.abs(poles - complex(real, imaginary)))) in group

    vectors = schur(A, output="real", sort=inside)[1]
    return np.asarray(vectors[:, : len(group)], dtype=np.float64)


def _groups(poles: ComplexArray) -> list[list[int]]:
    """Which eigenvalues stand in one section, slowest first, a single one last."""
    above = [k for k, pole in enumerate(poles) if pole.imag > 0.0]
    below = [k for k, pole in enumerate(poles) if pole.imag < 0.0]
    pairs = [[k, min(below, key=lambda j: abs(poles[j] - poles[k].conjugate()))] for k in above]
    real = sorted((k for k, pole in enumerate(poles) if pole.imag == 0.0), key=lambda k: poles[k].real)
    single: list[list[int]] = []
    if len(real) % 2:
        # The one is left alone without which the others lie closest to their neighbours.
        left = min(range(0, len(real), 2), key=lambda j: _width(poles, real[:j] + real[j + 1 :]))
        single = [[real.pop(left)]]
    pairs += [real[k : k + 2] for k in range(0, len(real), 2)]
    return [*sorted(pairs, key=lambda group: float(np.abs(poles[group]).min())), *single]


def _width(poles: ComplexArray, real: Sequence[int]) -> float:
    return float(sum(abs(poles[first] - poles[second]) for first, second in zip(real[::2], real[1::2], strict=True)))


def _check_distinct(poles: ComplexArray, groups: Sequence[Sequence[int]]) -> None:
    """Refuse poles that two sections would share."""
    size = 1e-300 + float(np.abs(poles).max(initial=0.0))
    for number, group in enumerate(groups):
        for other in groups[number + 1 :]:
            distances = np.abs(poles[list(group)][:, None] - poles[list(other)])
            if distances.min() < _SAME_POLE * size:
                pole = poles[list(group)][int(np.argmin(distances.min(axis=1)))]
                raise ModelError(
                    f"the pole {pole:.6g} is in two sections",
                    needed="different poles in different sections",
                    remedy="move one of them a little, or take a lower order",
                )


def least_observed(A: FloatArray, row: FloatArray) -> float:
    """How much an output shows of the mode of a section that it sees least.

    Parameters
    ----------
    A
        Of the section, shape ``(x, x)``.
    row
        What the output shows of its states, shape ``(x,)``.
    """
    rate = 1e-300 + float(np.linalg.norm(A, 2))
    shown = np.array([row @ np.linalg.matrix_power(A / rate, k) for k in range(len(A))])
    return float(np.linalg.svd(shown, compute_uv=False)[-1])


HIGHEST_ORDER = 20
LONGEST_DELAY_S = 1.0
_UNSEEN = 1e-9


def black_box(
    order: int,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    delays: bool = False,
    stable: bool = False,
    references: Sequence[str] = (),
) -> LinearStructure:
    """State space of an order, strictly proper, with every number free that the data can identify.

    Parameters
    ----------
    order
        Number of states, from 1 to 20.
    delays
        Whether every input may be delayed, by ``tau`` or ``tau_INPUT`` in seconds.
    stable
        Whether no mode may grow: a section decays just where its ``a0`` and ``a1`` are positive, so that bounds do it.
    references
        The output that scales each section, the first one by default. It must see the modes of its section:
        :func:`best_references` says which output sees them best.

    Returns
    -------
    LinearStructure
        With the states ``x1`` … and the parameters ``a0_1``, ``a1_1`` (section 1), ``b_x1`` … (``b_x1_INPUT`` with
        several inputs), ``c_OUTPUT_x1`` … for the outputs that are not the reference, and the delays. Units are those
        of a response without one; parameters have no start values of their own.

    Raises
    ------
    ModelError
        The order is impossible, an output is unknown, or a name is not allowed in an equation.

    Examples
    --------
    >>> black_box(3, ["phi_setpoint"], ["phi"]).parameters.names
    ('a0_1', 'a1_1', 'b_x1', 'b_x2', 'a0_2', 'b_x3')
    """
    sections = _sections(order)
    scales = tuple(references) or (outputs[0],) * len(sections)
    if len(scales) != len(sections):
        raise ModelError(
            f"got {len(scales)} reference outputs for {len(sections)} sections", needed="one for each section"
        )
    for output in scales:
        if output not in outputs:
            raise no_such("output", output, outputs)
    block = _Block.of(sections, tuple(inputs), tuple(outputs), scales, tail="")
    delays_of = {u: "tau" if len(inputs) == 1 else f"tau_{u}" for u in inputs} if delays else {}
    return _structure(f"black_box:{order}", [block], delays_of, stable=stable)


def black_box_pairs(
    order: int, pairs: Sequence[tuple[str, str]], *, delays: bool = False, stable: bool = False
) -> LinearStructure:
    """Black boxes of one order side by side, each from one input to one output, without coupling.

    Parameters
    ----------
    order
        Number of states of each pair, from 1 to 20.
    pairs
        Input and output of each pair; every input and output once.
    delays, stable
        As for :func:`black_box`.

    Returns
    -------
    LinearStructure
        With the parameters of :func:`black_box` for one input and one output, each followed by ``_OUTPUT``.

    Raises
    ------
    ModelError
        The order is impossible, a channel is in two pairs, or a name is not allowed in an equation.

    References
    ----------
    The general higher-order model of *System Identification of the Parrot Bebop 2*, section II-C, block by block.

    Examples
    --------
    >>> two = black_box_pairs(2, [("phi_setpoint", "phi"), ("theta_setpoint", "theta")], delays=True)
    >>> two.parameters.names[:5]
    ('a0_1_phi', 'a1_1_phi', 'b_x1_phi', 'b_x2_phi', 'a0_1_theta')
    """
    for kind, names in (("input", [u for u, _ in pairs]), ("output", [y for _, y in pairs])):
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ModelError(f"the {kind} {twice[0]} is in two pairs", needed="every channel in one pair")
    sections = _sections(order)
    blocks = [_Block.of(sections, (u,), (y,), (y,) * len(sections), tail=f"_{y}") for u, y in pairs]
    delays_of = {u: f"tau_{y}" for u, y in pairs} if delays else {}
    return _structure(f"black_box:{order}", blocks, delays_of, stable=stable)


def from_state_space(A: FloatArray, B: FloatArray, C: FloatArray, structure: LinearStructure) -> ParameterSet:
    r"""The parameters with which a black box is a given system :math:`\dot x = A x + B u`, :math:`y = C x`.

    The modes of a section are split off by an invariant subspace; the coordinates that its reference output shows,
    :math:`[c; c A]`, make its companion form. Complex pairs make a section each, real poles are paired with their
    neighbours, so that poles which may meet in a fit stand in one section.

    Parameters
    ----------
    A, B, C
        Shapes ``(x, x)``, ``(x, u)`` and ``(y, x)``.
    structure
        A structure of :func:`black_box` of the same order.

    Returns
    -------
    ParameterSet
        That of the structure with these values; delays keep theirs.

    Raises
    ------
    ModelError
        The shapes do not match, poles of two sections coincide, or a reference output does not see its section.

    Examples
    --------
    >>> box = black_box(2, ["u"], ["y"])
    >>> set_ = from_state_space(np.diag([-1.0, -2.0]), np.ones((2, 1)), np.ones((1, 2)), box)
    >>> {name: round(value, 9) for name, value in set_.values.items()}
    {'a0_1': 2.0, 'a1_1': 3.0, 'b_x1': 2.0, 'b_x2': -3.0}
    """
    order, (y, u) = len(structure.states), (len(structure.outputs), len(structure.inputs))
    if A.shape != (order, order) or B.shape != (order, u) or C.shape != (y, order):
        raise ModelError(
            f"got matrices of shapes {A.shape}, {B.shape} and {C.shape} for {structure.name}",
            needed=f"shapes {(order, order)}, {(order, u)} and {(y, order)}",
        )
    block = _Block.of(_sections(order), structure.inputs, structure.outputs, _scales(structure), tail="")
    values: dict[str, float] = {}
    for section, part in zip(block.sections, modal_parts(A, B, C), strict=True):
        row = structure.outputs.index(section.reference)
        _check_reference(section, part, row, float(np.linalg.norm(C[row])))
        values |= section.values(part)
    return structure.parameters.with_values(values)


def best_references(A: FloatArray, C: FloatArray, outputs: Sequence[str]) -> tuple[str, ...]:
    """The output that sees the modes of each section best, in the order of :func:`from_state_space`.

    Parameters
    ----------
    A, C
        Shapes ``(x, x)`` and ``(y, x)``.
    outputs
        Names of the outputs; those in other units should be scaled to the same size first.

    Raises
    ------
    ModelError
        Poles of two sections coincide.

    Examples
    --------
    >>> A, C = np.diag([-1.0, -1.2, -9.0, -9.5]), np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.1, 1.0, 1.0]])
    >>> best_references(A, C, ["p", "r"])
    ('p', 'r')
    """
    none = np.zeros((len(A), 0))
    observed = [[least_observed(part.A, row) for row in part.C] for part in modal_parts(A, none, C)]
    return tuple(outputs[int(np.argmax(rows))] for rows in observed)


class _Section(NamedTuple):
    """Names of one section: its states, inputs, outputs, and the output that scales it."""

    number: int
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    reference: str
    tail: str

    @property
    def poles(self) -> tuple[str, ...]:
        return tuple(f"a{k}_{self.number}{self.tail}" for k in range(len(self.states)))

    def gain(self, state: str, u: str) -> str:
        return f"b_{state}" if len(self.inputs) == 1 else f"b_{state}_{u}"

    def weight(self, output: str, state: str) -> str:
        return f"c_{output}_{state}"

    @property
    def equations(self) -> list[str]:
        feedback = "".join(f"- {a}*{x} " for a, x in zip(self.poles, self.states, strict=True))
        onward = (*self.states[1:], feedback)
        return [
            f"{x}' = {right} + " + " + ".join(f"{self.gain(x, u)}*{u}" for u in self.inputs)
            for x, right in zip(self.states, onward, strict=True)
        ]

    def output_text(self, output: str) -> str:
        """What an output shows of this section."""
        if output == self.reference:
            return self.states[0]
        return " + ".join(f"{self.weight(output, x)}*{x}" for x in self.states)

    def parameters(self, *, stable: bool) -> list[Parameter]:
        size, lowest = len(self.states), 0.0 if stable else -np.inf
        others = [output for output in self.outputs if output != self.reference]
        return [
            *(Parameter(name=a, unit=_per_second(size - k), lower=lowest) for k, a in enumerate(self.poles)),
            *(
                Parameter(name=self.gain(x, u), unit=_per_second(1 + k))
                for k, x in enumerate(self.states)
                for u in self.inputs
            ),
            *(
                Parameter(name=self.weight(output, x), unit="s" if k else "1")
                for output in others
                for k, x in enumerate(self.states)
            ),
        ]

    def values(self, part: Part) -> dict[str, float]:
        """The numbers with which this section is a part of a system."""
        row = part.C[self.outputs.index(self.reference)]
        shown = np.array([row @ np.linalg.matrix_power(part.A, k) for k in range(len(row))])
        back = np.linalg.inv(shown)
        A, B, C = shown @ part.A @ back, shown @ part.B, part.C @ back
        values = {a: -float(entry) for a, entry in zip(self.poles, A[-1], strict=True)}
        values |= {
            self.gain(x, u): float(B[k, j]) for k, x in enumerate(self.states) for j, u in enumerate(self.inputs)
        }
        return values | {
            self.weight(output, x): float(C[i, k])
            for i, output in enumerate(self.outputs)
            if output != self.reference
            for k, x in enumerate(self.states)
        }


class _Block(NamedTuple):
    """Sections that share inputs and outputs."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sections: tuple[_Section, ...]

    @classmethod
    def of(
        cls,
        sizes: Sequence[int],
        inputs: tuple[str, ...],
        outputs: tuple[str, ...],
        scales: Sequence[str],
        *,
        tail: str,
    ) -> _Block:
        ends = np.cumsum(sizes).tolist()
        states = [
            tuple(f"x{k + 1}{tail}" for k in range(end - size, end)) for size, end in zip(sizes, ends, strict=True)
        ]
        named = enumerate(zip(states, scales, strict=True), start=1)
        return cls(inputs, outputs, tuple(_Section(k, xs, inputs, outputs, y, tail) for k, (xs, y) in named))


def _structure(name: str, blocks: Sequence[_Block], delays: Mapping[str, str], *, stable: bool) -> LinearStructure:
    sections = [section for block in blocks for section in block.sections]
    taus = [Parameter(name=tau, unit="s", lower=0.0, upper=LONGEST_DELAY_S, value=0.0) for tau in delays.values()]
    return structure_from_equations(
        name=name,
        inputs=[u for block in blocks for u in block.inputs],
        states=[x for section in sections for x in section.states],
        equations=[equation for section in sections for equation in section.equations],
        outputs=[
            f"{y} = " + " + ".join(section.output_text(y) for section in block.sections)
            for block in blocks
            for y in block.outputs
        ],
        delays=delays,
        parameters=ParameterSet([*(p for section in sections for p in section.parameters(stable=stable)), *taus]),
        source="parallel sections in observable companion form",
    )


def _sections(order: int) -> tuple[int, ...]:
    """Number of states of each section."""
    if not 1 <= order <= HIGHEST_ORDER:
        raise ModelError(f"a black box of order {order} was asked for", needed=f"an order from 1 to {HIGHEST_ORDER}")
    return (2,) * (order // 2) + (1,) * (order % 2)


def _scales(structure: LinearStructure) -> tuple[str, ...]:
    """The reference output of each section: the one that shows its first state with a weight of one."""
    first = np.cumsum([0, *_sections(len(structure.states))])[:-1]
    fixed = structure.matrices(dict.fromkeys(structure.parameters.names, 0.0)).H0[:, first]
    if not (np.count_nonzero(fixed, axis=0) == 1).all() or len(fixed[0]) == 0:
        raise ModelError(f"{structure.name} is no black box in sections", needed="a structure of black_box")
    return tuple(structure.outputs[int(row)] for row in np.argmax(fixed, axis=0))


def _per_second(power: int) -> str:
    return "1/s" if power == 1 else f"1/s^{power}"


def _check_reference(section: _Section, part: Part, row: int, size: float) -> None:
    """Refuse a reference output that does not see the modes of its section."""
    if least_observed(part.A, part.C[row]) <= _UNSEEN * size:
        poles = ", ".join(f"{pole:.4g}" for pole in np.linalg.eigvals(part.A))
        raise ModelError(
            f"the output {section.reference} does not show the poles {poles}",
            needed="a reference output that sees the modes of its section",
            remedy="choose it with best_references, or take a lower order",
        )
