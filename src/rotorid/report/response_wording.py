"""What a run of ``response`` found, in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotorid.pipeline.response_document import LoopDocument, PairDocument, ResponseDocument
from rotorid.plot.quantity import quantity
from rotorid.report.numbers import significant, with_error
from rotorid.report.wording import finding_heading

_FEW = 3
"""So many responses are told one by one; of more, the best and the worst."""


def response_summary(document: ResponseDocument) -> tuple[str, ...]:
    """What was measured and how, what of it can be used, the loops, and the most serious finding.

    Parameters
    ----------
    document
        The result.
    """
    return (
        *_measured(document),
        *_usable(document),
        *(sentence for axis, loop in document.loops.items() if (sentence := _loop(axis, loop))),
        *_gravest(document),
    )


def _measured(document: ResponseDocument) -> tuple[str, str]:
    """The channels and the data; the estimate with its instruments."""
    outputs = listed([quantity(name).words for name in document.outputs])
    inputs = listed([quantity(name).words for name in document.inputs])
    used = [record for record in document.records if record.used]
    seconds = significant(sum(record.stop_s - record.start_s for record in used))
    kinds = {f"{record.axis} {record.kind.replace('_', ' ')}" for record in used}
    of = kinds.pop() if len(kinds) == 1 else "maneuver"
    data = f", from {len(used)} {of}{_s(used)} of {seconds} s{' together' if len(used) > 1 else ''}" if used else ""
    return f"{_capital(outputs)} over {inputs}{data}.", _estimate(document)


def _estimate(document: ResponseDocument) -> str:
    if document.estimate == "joint":
        instruments = f"{listed(document.instruments)} as instrument{_s(document.instruments)}"
        return f"Joint estimate with {instruments}, which keeps feedback out of it."
    return "Direct estimate, without an instrument: feedback through the controller may bias it."


def _usable(document: ResponseDocument) -> tuple[str, ...]:
    count = len(document.pairs)
    if count <= _FEW:
        return tuple(
            f"{_capital(_words(name))}: {f'usable {_band(pair)}' if pair.points else 'nothing can be used'}."
            for name, pair in document.pairs.items()
        )
    usable = {name: pair for name, pair in document.pairs.items() if pair.points}
    if not usable:
        return (f"None of the {count} responses can be used.",)
    ordered = sorted(usable, key=lambda name: _octaves(usable[name]))
    narrow, wide = ordered[0], ordered[-1]
    found = "All" if len(usable) == count else f"{len(usable)} of"
    return (
        f"{found} {count} responses can be used in some band.",
        f"Widest: {_words(wide)}, {_band(usable[wide])}.",
        *((f"Narrowest: {_words(narrow)}, {_band(usable[narrow])}.",) if narrow != wide else ()),
    )


def _words(name: str) -> str:
    """A response ``output/input`` in words."""
    output, _, input = name.partition("/")
    return f"{quantity(output).words} over {quantity(input).words}"


def _band(pair: PairDocument) -> str:
    """The usable band of a response and how good it is there."""
    low, high = pair.band_rad_s or (math.nan, math.nan)
    quality = f"a mean coherence of {pair.mean_coherence:.2f} and an error of"
    error = significant(100.0 * (pair.mean_random_error or 0.0), digits=2)
    return f"from {significant(low)} to {significant(high)} rad/s, with {quality} {error} %"


def _octaves(pair: PairDocument) -> float:
    low, high = pair.band_rad_s or (1.0, 1.0)
    return math.log2(high / low)


def _loop(axis: str, loop: LoopDocument) -> str:
    """Crossover and margins of one axis; empty where none was seen."""
    seen = []
    if crossover := loop.numbers.get("crossover_rad_s"):
        seen.append(f"crossover at {with_error(crossover.value, crossover.std)} rad/s")
    if phase := loop.numbers.get("phase_margin_rad"):
        seen.append(f"phase margin {with_error(math.degrees(phase.value), math.degrees(phase.std))}°")
    if up := loop.numbers.get("gain_margin_up"):
        std_db = 20.0 / math.log(10.0) * up.std / up.value
        seen.append(f"gain margin {with_error(20.0 * math.log10(up.value), std_db)} dB")
    if bandwidth := loop.numbers.get("attitude_bandwidth_rad_s"):
        seen.append(f"attitude bandwidth {with_error(bandwidth.value, bandwidth.std)} rad/s")
    return f"{axis.capitalize()} loop: {', '.join(seen)}." if seen else ""


def _gravest(document: ResponseDocument) -> tuple[str, ...]:
    for severity in ("error", "warning"):
        for finding in document.findings:
            if finding.severity == severity:
                where = f" ({finding.where})" if finding.where else ""
                heading = finding_heading(finding.kind)
                return (f"Most serious finding: {heading[:1].lower()}{heading[1:]}{where}: {finding.message}",)
    return ()


def listed(names: Sequence[str]) -> str:
    """Names as a reader lists them.

    Examples
    --------
    >>> listed(["p"]), listed(["p", "ay", "v"])
    ('p', 'p, ay and v')
    """
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _s(counted: Sequence[object]) -> str:
    return "" if len(counted) == 1 else "s"
