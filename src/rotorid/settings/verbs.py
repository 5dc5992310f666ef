"""Which commands have an option: what an error or a remedy names must exist where the reader stands.

A part of one command calls the parts of another: ``review`` identifies models, ``fleet`` reviews. Errors below name the
options of the command that they were written for. :func:`with_verbs` adds that command where the reader's own has no
such option.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

_OPTIONS: Mapping[str, str] = MappingProxyType(
    {
        "bench": "data label predictions",
        "compare simulate stitch": "log",
        "delay": "input output",
        "demo": "keep-log",
        "design": "amplitude entry for for-tune gains limit prior vehicle",
        "design export review simulate tune vehicles": "set",
        "design simulate": "duration turbulence wind",
        "design export simulate vehicles": "like",
        "design track tune": "axis",
        "export": "delay-as-lag draws no-delay pade sample-rate to",
        "export vehicles": "name",
        "fleet": "again memory resume review scheduler timeout vehicles",
        "identify response fleet": "workers",
        "fleet review": "models",
        "identify": "add-noise arm bootstrap constant cross-validate curve decoupled evaluations fix free known method "
        "pair predictor reduce rotor-diameter search speed-damping starts tie verify",
        "identify compare": "hold",
        "identify design track": "model",
        "identify export": "layout",
        "identify response": "correct-filters correct-sensors filter",
        "identify response delay demo design example export fleet simulate stitch tune": "seed",
        "identify response design models": "inputs outputs",
        "identify response verify compare delay": "shift",
        "identify response verify compare delay inspect review simulate stitch track tune": "map",
        "identify response verify compare delay simulate": "segment",
        "identify response verify compare bench demo design fleet inspect review simulate stitch track tune": "pdf",
        "identify response verify compare review simulate": "figures",
        "identify response verify compare bench simulate": "tables",
        "identify response verify delay": "coherence estimate instrument windows",
        "identify response verify delay design": "band",
        "identify simulate": "pieces runs",
        "inspect": "plot",
        "inspect review simulate": "plan",
        "lab": "no-open port token",
        "review": "no-models open",
        "simulate": "format speed",
        "track": "first step",
        "tune": "axes check filters judge keep noise only robustness",
        "vehicles": "from toml",
        "verify": "low-pass",
        "verify stitch": "controller",
        "verify tune": "scale",
    }
)

VERBS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {f"--{name}": tuple(verbs.split()) for verbs, names in _OPTIONS.items() for name in names.split()}
)
"""Option that a text of the library names, to the commands that have it; the first is the one to send a reader to."""

OPTION = re.compile(r"(?<![\w-])--[a-z]+(?:-[a-z]+)*")
"""An option as texts write it."""

_WITH_VALUE = re.compile(rf"({OPTION.pattern})(?: (?=[^\s;,)]*[:=\d]|[A-Z]{{2,}})[^\s;,)]*[^\s;,).])?")
_NAMED = re.compile(r"\brotorid ([a-z]+)")


def with_verbs(text: str, verb: str) -> str:
    """A text whose options are those of the reader's command, or have the name of another command behind them.

    Parameters
    ----------
    text
        Words of an error or a finding.
    verb
        The reader's command.

    Examples
    --------
    >>> with_verbs("name it with --layout", "review"), with_verbs("name it with --layout", "export")
    ('name it with --layout (rotorid identify)', 'name it with --layout')
    >>> with_verbs("or try --segment roll:5.00:35.00.", "inspect")
    'or try --segment roll:5.00:35.00 (rotorid identify).'
    >>> with_verbs("add --shift p:0.01 to rotorid identify", "review")
    'add --shift p:0.01 to rotorid identify'
    """
    named = set(_NAMED.findall(text))

    def qualified(found: re.Match[str]) -> str:
        verbs = VERBS.get(found[1], ())
        return found[0] if not verbs or verb in verbs or named & set(verbs) else f"{found[0]} (rotorid {verbs[0]})"

    return _WITH_VALUE.sub(qualified, text) if "--" in text else text
