"""Measured responses in words, shared by their page and the terminal."""

from __future__ import annotations

import math
from dataclasses import replace

from rotorid.data.display import capital, counted, listed
from rotorid.data.quantity import in_decibels, significant, with_error
from rotorid.loops.rate_loops import AxisLoop
from rotorid.loops.responses import Pair, Responses
from rotorid.plot.figure import quantity
from rotorid.report.findings import finding_heading

_FEW = 3
"""Up to this many responses are listed one by one; of more, the best and the worst."""


def response_summary(result: Responses) -> tuple[str, ...]:
    """What was measured and how, the usable bands, the loops, and the most serious finding."""
    return (
        *_measured(result),
        *_usable(result),
        *(sentence for axis, loop in result.loops.items() if (sentence := _loop(axis, loop))),
        *_gravest(result),
    )


def _measured(result: Responses) -> tuple[str, str]:
    """The channels and the data; the estimate with its instruments."""
    outputs = listed([quantity(name).words for name in result.outputs])
    inputs = listed([quantity(name).words for name in result.inputs])
    used = [record for record in result.records if record.used]
    seconds = significant(sum(record.stop_s - record.start_s for record in used))
    kinds = {f"{record.axis} {record.kind.replace('_', ' ')}" for record in used}
    of = kinds.pop() if len(kinds) == 1 else "maneuver"
    data = f", from {counted(len(used), of)} of {seconds} s{' together' if len(used) > 1 else ''}" if used else ""
    return f"{capital(outputs)} over {inputs}{data}.", _estimate(result)


def _estimate(result: Responses) -> str:
    if result.estimate == "joint":
        noun = "instrument" if len(result.instruments) == 1 else "instruments"
        instruments = f"{listed(result.instruments)} as {noun}"
        return f"Joint estimate with {instruments}, so feedback does not bias it."
    return "Direct estimate without an instrument: feedback through the controller may bias it."


def _usable(result: Responses) -> tuple[str, ...]:
    count = len(result.pairs)
    if count <= _FEW:
        return tuple(
            f"{capital(_words(name))}: {f'usable {_band(pair)}' if pair.points else 'not usable'}."
            for name, pair in result.pairs.items()
        )
    usable = {name: pair for name, pair in result.pairs.items() if pair.points}
    if not usable:
        return (f"None of the {count} responses is usable.",)
    ordered = sorted(usable, key=lambda name: _octaves(usable[name]))
    narrow, wide = ordered[0], ordered[-1]
    found = "All" if len(usable) == count else f"{len(usable)} of"
    first = f"{found} {count} responses are usable in some band."
    if narrow != wide and len({pair.band_rad_s for pair in usable.values()}) == 1:
        coherence = min(pair.mean_coherence or 0.0 for pair in usable.values())
        worst = max(pair.mean_random_error or 0.0 for pair in usable.values())
        band = _band(replace(usable[wide], mean_coherence=coherence, mean_random_error=worst))
        return (first, f"Each is usable {band} at worst.")
    return (
        first,
        f"Widest: {_words(wide)}, {_band(usable[wide])}.",
        *((f"Narrowest: {_words(narrow)}, {_band(usable[narrow])}.",) if narrow != wide else ()),
    )


def _words(name: str) -> str:
    """A response ``output/input`` in words."""
    output, _, input = name.partition("/")
    return f"{quantity(output).words} over {quantity(input).words}"


def _band(pair: Pair) -> str:
    """The usable band of a response and how good it is there."""
    low, high = pair.band_rad_s or (math.nan, math.nan)
    quality = f"mean coherence {pair.mean_coherence:.2f}, random error"
    error = significant(100.0 * (pair.mean_random_error or 0.0), digits=2)
    return f"from {significant(low)} to {significant(high)} rad/s, {quality} {error} %"


def _octaves(pair: Pair) -> float:
    low, high = pair.band_rad_s or (1.0, 1.0)
    return math.log2(high / low)


def _loop(axis: str, loop: AxisLoop) -> str:
    """Crossover and margins of one axis, for the rate loop and the whole loop; empty where none was measured."""
    whole = _loop(axis, loop.whole) if loop.whole is not None else ""
    sentences = []
    if crossover := loop.numbers.get("crossover_rad_s"):
        sentences.append(f"crossover at {with_error(crossover.value, crossover.std)} rad/s")
    if phase := loop.numbers.get("phase_margin_rad"):
        sentences.append(f"phase margin {with_error(math.degrees(phase.value), math.degrees(phase.std))}°")
    if up := loop.numbers.get("gain_margin_up"):
        sentences.append(f"gain margin {in_decibels(up.value, up.std)} dB")
    if bandwidth := loop.numbers.get("attitude_bandwidth_rad_s"):
        sentences.append(f"attitude bandwidth {with_error(bandwidth.value, bandwidth.std)} rad/s")
    name = "Whole loop" if loop.scope == "whole" else "Rate loop"
    own = f"{name} of {axis}: {', '.join(sentences)}." if sentences else ""
    return " ".join(sentence for sentence in (own, whole) if sentence)


def _gravest(result: Responses) -> tuple[str, ...]:
    for severity in ("error", "warning"):
        for finding in result.findings:
            if finding.severity == severity:
                where = f" ({finding.where})" if finding.where else ""
                heading = finding_heading(finding.kind)
                return (f"Most serious finding: {heading[:1].lower()}{heading[1:]}{where}: {finding.message}",)
    return ()
