"""Answers of tools: what a command printed, small enough to be read whole, with the spans of the log that show it.

An answer keeps what a command says about its own limits: verdicts, warnings, and what was not measured or checked. What
is cut is listed by key in ``left_out``, so that a part which is missing is never taken for one that does not exist.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rotorid.data.display import cut
from rotorid.documents.answer import AnswerDocument, SpanDocument
from rotorid.letters import HIDDEN, visible

MOST_BYTES = 20_000
"""Largest answer, as text in UTF-8."""

DETAILS: Mapping[str, tuple[str, ...]] = {
    "rotorid.inspect/1": ("sha256", "kinematics", "skews", "channels", "settings", "parameters"),
    "rotorid.brief/1": ("sha256",),
    "rotorid.result/1": (
        *("fit", "hold", "pieces_s", "noise", "log_likelihood", "information", "residuals", "minima", "search"),
        *("bootstrap", "noise_runs", "equations", "frequency_fit", "orders", "correlation", "matrices", "covered"),
        *("controller", "provenance", "derived", "constants", "filters_removed", "motors.command", "states"),
    ),
    "rotorid.tune/1": ("provenance", "filter_curve.points"),
    "rotorid.verify/1": ("covered", "provenance", "states"),
    "rotorid.export/1": ("command", "numbers"),
}
"""Keys of each document that are details: an answer leaves them out."""

KEPT = frozenset(
    (
        "answers",
        "cannot_tell",
        "verdict",
        "judged",
        "findings",
        "evidence",
        "cards",
        "parameters",
        "supports",
        "maneuvers",
    )
)
"""Keys that have room before all others."""

_OF_PARAMETERS = frozenset(("value", "lower", "upper", "std", "unit", "status"))
_MOST_TEXT = 600
_SHARES = {"evidence": 4000, "not_checked": 4000, "files": 1500}
_ROOM_FOR_LEFT_OUT = 1500
_SMALL = 100
"""A part that would get less room than this goes as a whole."""

_MOST_NAMED = 8
"""Keys of one part that are named when they go; of more their number is."""


def bounded(answer: AnswerDocument) -> str:
    """An answer as JSON text of at most 20 kB.

    Details go first, then notes; then parts share the room, small ones whole, long lists up to where they fit. Every
    key that was cut is in ``left_out``.

    Examples
    --------
    >>> large = AnswerDocument(tool="details", state="done", answer={"curve": [0.5] * 9000, "verdict": "good"})
    >>> text = bounded(large)
    >>> len(text) < 20_000, json.loads(text)["left_out"], json.loads(text)["answer"]["verdict"]
    (True, ['curve: 4577 of 9000'], 'good')
    """
    body = _rounded(answer.model_dump(by_alias=True))
    body["sentence"] = cut(body["sentence"], _MOST_TEXT)
    left_out: list[str] = body["left_out"]
    for name, most in _SHARES.items():
        body[name] = _fit(body[name], most, name, left_out)
    parts = _parts(body["answer"])
    for prefix, part in parts:
        _drop_details(part, prefix, left_out)
    if _size(body) > MOST_BYTES:
        for prefix, part in parts:
            _drop_notes(part, prefix, left_out)
    left_out[:] = dict.fromkeys(left_out)
    rest = _size({**body, "answer": None, "left_out": []}) + _ROOM_FOR_LEFT_OUT
    body["answer"] = _fit(body["answer"], MOST_BYTES - rest, "", left_out)
    body["left_out"] = _named(left_out)
    return _text(body)


def not_checked(document: Any) -> list[str]:
    """What a document says was not measured or checked.

    Examples
    --------
    >>> not_checked({"cannot_tell": [{"what": "battery", "why": "Not logged.", "remedy": ""}]})
    ['battery']
    """
    found: dict[str, None] = {}
    for _, part in _parts(document):
        # Why, and what to do about it, stays in the document.
        found |= dict.fromkeys(str(row.get("what")) for row in part.get("cannot_tell") or ())
        kinds = [row for row in part.get("findings") or () if _is_unchecked(str(row.get("kind", "")))]
        found |= dict.fromkeys(f"{row['kind']}: {row.get('message', '')}" for row in kinds)
        found |= dict.fromkeys(
            f"{axis}: not enough data for a verdict"
            for axis, judged in ((part.get("judged") or {}).get("axes") or {}).items()
            if judged.get("verdict") == "not_enough_data"
        )
        if "model" in part and "parameters" in part and part.get("parameters") and not _maneuvers(part):
            found[f"{part['model']}: no unseen maneuver was left to validate it"] = None
    return [cut(text, _MOST_TEXT) for text in found]


def evidence(document: Any) -> list[SpanDocument]:
    """The spans of logs that a document names: flights, excitations, fitted and unseen maneuvers.

    Examples
    --------
    >>> [span.use for span in evidence({"name": "a.ulg", "flights": [{"start_s": 1.0, "stop_s": 9.0}]})]
    ['in the air']
    """
    found: dict[tuple[str, str, float, float], SpanDocument] = {}
    for _, part in _parts(document):
        for span in _spans(part):
            found[span.log, span.use, span.start_s, span.stop_s] = span
    return list(found.values())


def _is_unchecked(kind: str) -> bool:
    return "unchecked" in kind or "not_checked" in kind


def _parts(document: Any) -> list[tuple[str, dict[str, Any]]]:
    """A document, or those that it lists, with the key of each."""
    if not isinstance(document, dict):
        return []
    for name in ("results", "reviews", "inspections"):
        rows = document.get(name)
        if isinstance(rows, list) and rows and isinstance(rows[0], dict):
            return [(f"{name}.*.", row) for row in rows]
    return [("", document)]


def _maneuvers(part: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Unseen maneuvers of a result or of a verification."""
    verification = part.get("verification") or {}
    return [*(part.get("maneuvers") or ()), *(verification.get("maneuvers") or ()), *(verification.get("sweeps") or ())]


def _spans(part: Mapping[str, Any]) -> Iterator[SpanDocument]:
    name = str(part.get("name") or "")
    # Those of a verification were not fitted.
    fitted = () if "verification" not in part else (part.get("provenance") or {}).get("maneuvers") or ()
    rows = [
        *(("in the air", row) for row in part.get("flights") or ()),
        *(("in the air", {"start_s": start_s, "stop_s": stop_s}) for start_s, stop_s in part.get("flights_s") or ()),
        *(("excitation", row) for row in part.get("excitations") or ()),
        *(("fitted", row) for row in fitted),
        *(("unseen" if "verification" in part else "verified", row) for row in _maneuvers(part)),
    ]
    for use, row in rows:
        if isinstance(row, dict) and "start_s" in row and "stop_s" in row:
            words = " ".join(str(row[key]) for key in ("axis", "kind") if row.get(key))
            yield SpanDocument(
                log=visible(str(row.get("record") or name)),
                use=f"{use}: {words}" if words else use,
                start_s=row["start_s"],
                stop_s=row["stop_s"],
            )


# Size


def _drop_details(part: dict[str, Any], prefix: str, left_out: list[str]) -> None:
    for key in DETAILS.get(str(part.get("schema")), ()):
        holder, _, name = key.rpartition(".")
        place = part.get(holder) if holder else part
        value = place.pop(name, None) if isinstance(place, dict) else None
        # An empty part says that there is nothing, which its absence says too.
        if isinstance(value, dict | list) and value:
            left_out.append(prefix + key)


def _drop_notes(part: dict[str, Any], prefix: str, left_out: list[str]) -> None:
    """Keep warnings, each kind once with its count, and of parameters their values and intervals; notes go."""
    parameters = part.get("parameters")
    for row in parameters.values() if isinstance(parameters, dict) else ():
        for name in set(row) - _OF_PARAMETERS if isinstance(row, dict) else ():
            del row[name]
    rows = part.get("findings")
    if not isinstance(rows, list):
        return
    kept: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        if row.get("severity") == "info" and not _is_unchecked(str(row.get("kind"))):
            continue
        key = str(row.get("kind")), str(row.get("severity"))
        first = kept.setdefault(
            key, {name: row[name] for name in row if name not in ("numbers", "count")} | {"count": 0}
        )
        first["count"] += row.get("count", 1)
    part["findings"] = list(kept.values())
    if len(kept) < len(rows):
        left_out.append(f"{prefix}findings: warnings only" if prefix else f"findings: {len(kept)} of {len(rows)}")


def _fit(value: Any, most: int, key: str, left_out: list[str]) -> Any:
    """A part in so many bytes; what goes is added to ``left_out``."""
    if _size(value) <= most:
        return value
    if isinstance(value, dict):
        return _fit_parts(value, most, key, left_out)
    if isinstance(value, list):
        rows, room = [], most - 2
        for row in value:
            room -= _size(row) + 1
            if room < 0:
                break
            rows.append(row)
        left_out.append(f"{key or 'answer'}: {len(rows)} of {len(value)}")
        return rows
    text = str(value)
    # A sign takes at most six bytes.
    return cut(text, max(most // 6 - 2, 1))


def _fit_parts(value: Mapping[str, Any], most: int, key: str, left_out: list[str]) -> dict[str, Any]:
    """Parts that share the room evenly: small ones leave theirs to the others, and what must stay is served first."""
    sizes = {name: _size(name) + _size(part) + 2 for name, part in value.items()}
    # A number goes as a whole: never without its interval, unit and status.
    least = {
        name: sizes[name] if isinstance(part, dict) and "value" in part else min(sizes[name], _SMALL + _size(name))
        for name, part in value.items()
    }
    granted = _granted(sizes, least, most - 2)
    kept: dict[str, Any] = {}
    gone: list[str] = []
    for name, part in value.items():
        path = f"{key}.{name}" if key else str(name)
        if name in granted:
            kept[name] = _fit(part, granted[name] - _size(name) - 2, path, left_out)
        else:
            gone.append(path)
    left_out += gone if len(gone) <= _MOST_NAMED else [f"{key or 'answer'}: {len(kept)} of {len(value)} keys"]
    return kept


def _granted(sizes: Mapping[str, int], least: Mapping[str, int], room: int) -> dict[str, int]:
    """Bytes for each part that stays; the largest go until every other one has room for something."""
    first = {name: size for name, size in sizes.items() if name in KEPT}
    others = {name: size for name, size in sizes.items() if name not in KEPT}
    granted: dict[str, int] = {}
    for group in (first, others):
        while True:
            shares = _shares(group, room)
            starved = [name for name in group if shares[name] < least[name]]
            if not starved:
                break
            for name in sorted(group, key=group.__getitem__)[-max(len(starved) // 2, 1) :]:
                del group[name]
        granted |= shares
        room -= sum(shares.values())
    return granted


def _shares(sizes: Mapping[str, int], room: int) -> dict[str, int]:
    """Bytes for each part: an even share, or its size where it is smaller."""
    shares: dict[str, int] = {}
    for place, (name, size) in enumerate(sorted(sizes.items(), key=lambda pair: pair[1])):
        shares[name] = max(min(size, room // (len(sizes) - place)), 0)
        room -= shares[name]
    return shares


def _named(left_out: Sequence[str]) -> list[str]:
    """Keys that were cut, as many as have room, and how many more there are."""
    rows = [cut(row, _MOST_TEXT // 4) for row in left_out]
    while _size(rows) > _ROOM_FOR_LEFT_OUT - 40:
        rows = rows[: len(rows) * 3 // 4]
    return rows if len(rows) == len(left_out) else [*rows, f"and {len(left_out) - len(rows)} more"]


def _rounded(value: Any) -> Any:
    """Numbers with six digits, and to the millisecond where they are times."""
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return round(value, max(3, 5 - math.floor(math.log10(abs(value))))) if value else value
    if isinstance(value, dict):
        return {name: _rounded(part) for name, part in value.items()}
    return [_rounded(part) for part in value] if isinstance(value, list | tuple) else value


def _text(body: Any) -> str:
    text = json.dumps(body, ensure_ascii=False, separators=(",", ":"))
    return HIDDEN.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _size(value: Any) -> int:
    return len(_text(value).encode())
