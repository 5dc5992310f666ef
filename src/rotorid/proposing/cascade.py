"""Outer loops around the inner ones, with flown gains, with proposed ones, or with those of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.proposing.axis import KnownAxis, known_axis
from rotorid.proposing.outer import InnerLoop, OuterMaterial, known_outer, with_values
from rotorid.proposing.settings import TUNED_AXES, TuneSettings
from rotorid.results.model import IdentifiedModel
from rotorid.tuning.loops import Gains
from rotorid.typing import Axis, LoopName


class Cascade:
    """Outer loops around the inner ones, as flown and as they will fly."""

    def __init__(
        self,
        given: Sequence[IdentifiedModel],
        logs: Sequence[FlightRecord],
        settings: TuneSettings,
        known: Mapping[Axis, KnownAxis],
    ) -> None:
        self.findings: list[Finding] = []
        # Why an axis that was asked for is not known is said of it already.
        self._lacking = ""
        self._asked, self._given, self._logs, self._settings = known, tuple(given), tuple(logs), settings

    @cached_property
    def known(self) -> dict[Axis, KnownAxis]:
        """Inner loops: those that are tuned, and roll and pitch where they are known."""
        found, own = dict(self._asked), self._settings
        for axis in TUNED_AXES[:2]:
            if axis not in found and axis not in own.inner:
                try:
                    found[axis] = known_axis(
                        axis,
                        self._given,
                        self._logs,
                        filters=own.filters,
                        draws=own.draws,
                        seed=own.seed,
                        findings=self.findings,
                    )
                except InsufficientDataError as error:
                    self._lacking = self._lacking or error.came
        return found

    def outer(self, loop: LoopName, gains: Mapping[LoopName, Gains]) -> tuple[KnownAxis, list[Finding]]:
        """An outer loop around loops with their proposed gains."""
        new = {axis: InnerLoop(one, gains.get(axis, one.gains), one.then) for axis, one in self.known.items()}
        return known_outer(loop, self._material(self._flown), self._material(new))

    def with_parameters(self, loop: LoopName, values: Mapping[str, float]) -> KnownAxis:
        """An outer loop around loops with the parameters of a file."""
        then = {axis: with_values(one.flown.record, values) for axis, one in self.known.items()}
        new = {
            axis: InnerLoop(one, Gains.of(one.flown.with_parameters(then[axis]).controller), then[axis])
            for axis, one in self.known.items()
        }
        return known_outer(loop, self._material(self._flown), self._material(new, values))[0]

    @property
    def _flown(self) -> dict[Axis, InnerLoop]:
        return {axis: InnerLoop(one, one.gains) for axis, one in self.known.items()}

    def _material(self, inner: Mapping[Axis, InnerLoop], values: Mapping[str, float] | None = None) -> OuterMaterial:
        return OuterMaterial(
            given=self._given,
            logs=self._logs,
            inner=inner,
            draws=self._settings.draws,
            seed=self._settings.seed,
            values=values or {},
            lacking=self._lacking,
        )
