"""Outputs to the motors at the rate of the commands, from what follows for the demands of thrust."""

from __future__ import annotations

from rotorid.data.record import FlightRecord
from rotorid.signal.motors import linearization_of, reconstructed_demands, voltage_share
from rotorid.typing import FloatArray


def reconstructed_outputs(record: FlightRecord, mixer: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stamps and outputs, shape ``(motors, samples)``, by the gain of the slow outputs and the logged voltage."""
    demands, agreement = reconstructed_demands(record, mixer)
    known = linearization_of(record)
    assert known is not None
    assert agreement is not None
    share = voltage_share(record, known, demands.time_s)
    return demands.time_s, known.outputs(demands.values, gain=agreement.gain, voltage_share=share)
