"""Time response of a nonlinear model by SciPy's adaptive integrators: slow, and as exact as is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.ties import no_such
from rotorid.simulate.hold import Hold
from rotorid.simulate.nonlinear import checked_inputs, checked_vector, late_pieces, observed_plainly
from rotorid.typing import FloatArray

AdaptiveMethod: TypeAlias = Literal["rk23", "rk45", "dop853", "radau", "bdf", "lsoda"]

_SCIPY: Mapping[str, str] = {
    "rk23": "RK23",
    "rk45": "RK45",
    "dop853": "DOP853",
    "radau": "Radau",
    "bdf": "BDF",
    "lsoda": "LSODA",
}


def simulate_adaptive(
    structure: NonlinearStructure,
    values: Mapping[str, float],
    u: FloatArray,
    *,
    sample_rate_hz: float,
    x0: FloatArray | None = None,
    before: FloatArray | None = None,
    hold: Hold = "zero",
    method: AdaptiveMethod = "dop853",
    relative: float = 1e-10,
    absolute: float = 1e-12,
) -> FloatArray:
    """Outputs of a nonlinear model, integrated anew from corner to corner of its inputs.

    Meant as the truth for :func:`rotorid.simulate.nonlinear.simulate_nonlinear`, and for stiff models (``radau``,
    ``bdf``, ``lsoda``). It starts again at every corner, some milliseconds each.

    Parameters
    ----------
    structure, values, u, sample_rate_hz, x0, before
        As for :func:`~rotorid.simulate.nonlinear.simulate_nonlinear`.
    hold
        What the inputs do between their samples.
    method
        ``rk23``, ``rk45`` and ``dop853``: explicit Runge–Kutta. ``radau``, ``bdf``: implicit. ``lsoda``: Adams or
        backward differences, whichever suits.
    relative, absolute
        Tolerances of the error of each step.

    Returns
    -------
    FloatArray
        Shape ``(y, samples)``.

    Raises
    ------
    UsageError
        A shape does not match the model, or there is no such method.
    InsufficientDataError
        The integrator gives up: the model leaves the region in which it has values.
    """
    import scipy.integrate

    from rotorid.simulate.nonlinear_kernels import run

    if method not in get_args(AdaptiveMethod):
        error = no_such("adaptive method", method, _SCIPY)
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy)
    inputs = checked_inputs(structure, u)
    past = checked_vector(before, len(inputs), "before")
    count = len(structure.parameters)
    pieces = late_pieces(structure, values, np.zeros((count, 0)), sample_rate_hz)
    held, ramps = pieces.between(inputs, past)
    numbers = np.array([float(values[name]) for name in structure.parameters.names])
    program, order = structure.plain[0], len(structure.states)
    slots = program.tape.slots(np.concatenate([np.zeros(order + len(inputs)), numbers]))
    operations = program.tape.operations.copy()
    results = program.tape.results[: program.size]

    def rates(time: float, x: FloatArray, sample: int, piece: int) -> FloatArray:
        slots[:order] = x
        slots[order : order + len(inputs)] = held[sample, piece]
        if hold == "first":
            ages = time - pieces.fractions + pieces.pending[piece]
            slots[order : order + len(inputs)] += ramps[sample, piece] * ages
        run(operations, 0, len(operations), slots)
        rate: FloatArray = slots[results] / sample_rate_hz
        return rate

    solve: Any = scipy.integrate.solve_ivp
    states = np.empty((inputs.shape[1], order))
    states[0] = x = checked_vector(x0, order, "x0")
    for sample in range(len(states) - 1):
        for piece, (start, length) in enumerate(zip(pieces.starts, pieces.lengths, strict=True)):
            end = solve(
                rates,
                (start, start + length),
                x,
                method=_SCIPY[method],
                rtol=relative,
                atol=absolute,
                args=(sample, piece),
            )
            if not end.success:
                raise InsufficientDataError(f"the integrator stopped at sample {sample}: {end.message}")
            x = np.asarray(end.y[:, -1], dtype=np.float64)
        states[sample + 1] = x
    late = pieces.at_samples(inputs, past, hold=hold)
    return observed_plainly(structure, np.concatenate([states[..., None], late], axis=1), numbers)
