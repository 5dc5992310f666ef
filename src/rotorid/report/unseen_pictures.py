"""Bode pictures of sweeps that the fit had not seen, with the model over them and the cost of each response."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from rotorid.pipeline.judged import Judged, JudgedPair
from rotorid.plot.bode import COHERENCE_GUIDELINE, bode
from rotorid.plot.quantity import quantity
from rotorid.report.model_pictures import by_axis, on_axis
from rotorid.report.numbers import significant
from rotorid.report.picture import Picture, in_all_units
from rotorid.report.wording import Verdict, cost_verdict

_MOST_UNFOLDED = 4


@dataclass(frozen=True, kw_only=True, slots=True)
class UnseenResponse:
    """One response of unseen sweeps on the page."""

    name: str
    words: str
    cost: str
    verdict: Verdict
    band: str
    points: str
    leading: bool
    picture: Picture | None


@dataclass(frozen=True, kw_only=True, slots=True)
class UnseenSweeps:
    """Sweeps of one or several logs."""

    records: tuple[str, ...]
    responses: tuple[UnseenResponse, ...]

    @property
    def leading(self) -> tuple[UnseenResponse, ...]:
        """Responses with a picture in sight."""
        return tuple(one for one in self.responses if one.leading and one.picture)

    @property
    def folded(self) -> tuple[UnseenResponse, ...]:
        """Responses whose picture folds away."""
        return tuple(one for one in self.responses if not one.leading and one.picture)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures."""
        return tuple(one.picture for one in self.responses if one.picture)


def unseen_sweeps(judged: Judged, *, key: str, least_coherence: float = COHERENCE_GUIDELINE) -> UnseenSweeps:
    """Everything that the page says about unseen sweeps.

    Parameters
    ----------
    judged
        Measured and modelled responses, and their costs.
    key
        Prefix of the identifiers of its pictures.
    least_coherence
        Coherence below which points were left out.
    """
    pairs = by_axis([(name.partition("/")[0], name.partition("/")[2]) for name in judged.pairs])
    main = sum(on_axis(*pair) for pair in pairs)
    leading = main if main and len(pairs) > _MOST_UNFOLDED else len(pairs)
    return UnseenSweeps(
        records=judged.records,
        responses=tuple(
            _response(judged, output, input, f"{key}-{number}", number < leading, least_coherence)
            for number, (output, input) in enumerate(pairs)
        ),
    )


def _response(
    judged: Judged, output: str, input: str, key: str, leading: bool, least_coherence: float
) -> UnseenResponse:
    pair: JudgedPair = judged.pairs[f"{output}/{input}"]
    words = f"{quantity(output).words} over {quantity(input).words}"
    picture = None
    if judged.response is not None and judged.model_response is not None:
        draw = partial(
            bode,
            judged.response,
            output=output,
            input=input,
            model=judged.model_response,
            fitted=judged.used,
            least_coherence=least_coherence,
        )
        described = f"Bode plot of {words} of unseen sweeps, measured and model"
        picture = in_all_units(draw, key=key, description=described, converted=True)
    return UnseenResponse(
        name=f"{output}/{input}",
        words=words,
        cost=significant(pair.cost),
        verdict=cost_verdict(pair.cost),
        band=f"{significant(pair.band_rad_s[0])} to {significant(pair.band_rad_s[1])} rad/s",
        points=str(pair.points),
        leading=leading,
        picture=picture,
    )
