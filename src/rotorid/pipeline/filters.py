"""Known filters of the autopilot, taken off measured responses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rotorid.data.findings import Finding
from rotorid.errors import UsageError
from rotorid.pipeline.cutting import source_of
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.measure import Measured
from rotorid.signal.autopilot_filters import filter_findings, known_filters
from rotorid.signal.known_filter import KnownFilter
from rotorid.spectral.derived import corrected


def without_known_filters(measured: Measured, flown: Sequence[Flown]) -> Measured:
    """Responses as they would be without the filters that the logs say stood in front of their outputs.

    Parameters
    ----------
    measured
        The responses.
    flown
        Records and maneuvers behind them; the filters follow from the parameters of the records.

    Raises
    ------
    UsageError
        The records were filtered differently, so that one response of all of them cannot be corrected.
    """
    chains: dict[str, tuple[KnownFilter, ...]] = {}
    findings: list[Finding] = []
    for output in measured.response.outputs:
        sources = {source_of(segment, output) for segment in measured.segments}
        found = [known_filters(record, source) for source in sorted(sources) for record, _ in flown]
        if any(chain != found[0] for chain in found):
            raise UsageError(
                f"{output} was filtered differently in the logs",
                needed="one set of filters for all logs",
                remedy="estimate each log by itself, or leave out --correct-filters",
            )
        if found[0]:
            chains[output] = found[0]
        findings += [f for source in sorted(sources) for f in filter_findings(flown[0][0], source)]
    remarked = replace(measured, findings=(*measured.findings, *findings))
    if not chains:
        return remarked
    beside = None if measured.beside is None else corrected(measured.beside, chains)
    return replace(remarked, response=corrected(measured.response, chains), beside=beside)


def filter_delays(measured: Measured, flown: Sequence[Flown]) -> dict[str, float]:
    """Output to the delay in seconds of the known filters in front of it, where all logs had the same ones.

    Parameters
    ----------
    measured
        The responses.
    flown
        Records and maneuvers behind them.
    """
    delays: dict[str, float] = {}
    for output in measured.response.outputs:
        sources = sorted({source_of(segment, output) for segment in measured.segments})
        chains = [known_filters(record, source) for source in sources for record, _ in flown]
        if chains[0] and all(chain == chains[0] for chain in chains):
            delays[output] = sum(known.delay_s for known in chains[0])
    return delays
