"""Model structures as TOML text: written with the identified values, and read back as a model."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping

from rotorid.models.description_parameters import read_parameters
from rotorid.models.description_source import Source
from rotorid.models.description_structure import read_structure
from rotorid.models.description_write import SCHEMA, to_toml
from rotorid.models.structure import LinearStructure

__all__ = ["SCHEMA", "from_toml", "to_toml"]

_BOTH = ("schema", "name", "inputs", "states", "outputs", "gain", "optional", "source", "constants", "parameters")
_EQUATIONS = (*_BOTH, "equations", "delays")
_MATRICES = (*_BOTH, "M", "F", "G", "H0", "H1", "input_delays", "output_delays")
_NEEDED = ("name", "inputs", "states", "outputs", "parameters")


def from_toml(text: str, *, where: str = "the model") -> LinearStructure:
    """Read a structure; its parameters start from the values in the text.

    A model is written with equations, as a paper prints them, or with matrices::

        equations = ["q' = M_q*q + M_pitch*pitch_command"]     F = [["M_q"]]
        outputs = ["q"]                                        G = [["M_pitch"]]
        [delays]                                               H0 = [[1]]
        pitch_command = "tau_pitch"                            input_delays = ["tau_pitch"]

    Parameters
    ----------
    text
        As :func:`to_toml` writes it, or by hand.
    where
        Name of the file, for messages.

    Raises
    ------
    ModelError
        The text is no TOML, or what it says is no model. Name of the file, line and the text of that line are given.

    Examples
    --------
    >>> lag = from_toml('''
    ... name = "lag"
    ... inputs = ["u"]
    ... states = ["x"]
    ... equations = ["T*x' = -x + u"]
    ... outputs = ["x"]
    ... [parameters.T]
    ... value = 0.1
    ... unit = "s"
    ... ''')
    >>> lag.parameters.values
    {'T': 0.1}
    """
    source = Source(text=text, where=where)
    table = _table(source)
    _check_keys(table, source)
    constants = source.numbers(table.get("constants", {}), ("constants",))
    parameters = read_parameters(table["parameters"], constants, source)
    return read_structure(table, parameters, constants, source)


def _table(source: Source) -> Mapping[str, object]:
    try:
        return tomllib.loads(source.text)
    except (ValueError, RecursionError) as error:  # too long a number and too deep a nesting are no decode errors
        message = str(error)
        line = re.search(r"at line (\d+)", message)
        last = 1 + source.text.rstrip("\n").count("\n")
        at = int(line[1]) if line else last if "end of document" in message else 1
        raise source.error_at(at, f"this is not valid TOML: {message}", remedy="correct the line it names") from error


def _check_keys(table: Mapping[str, object], source: Source) -> None:
    schema = table.get("schema", SCHEMA)
    if schema != SCHEMA:
        raise source.error(("schema",), f"the model has the schema {schema!r}", needed=SCHEMA)
    known = _EQUATIONS if "equations" in table else _MATRICES
    if unknown := [key for key in table if key not in known]:
        if unknown[0] in (*_EQUATIONS, *_MATRICES):
            came = f"the model has both equations and {unknown[0]}"
            raise source.error((unknown[0],), came, needed="equations and delays, or matrices")
        raise source.unknown("key", unknown[0], known, (unknown[0],))
    needed = _NEEDED if "equations" in table else (*_NEEDED, "F", "G", "H0")
    if missing := [key for key in needed if key not in table]:
        came = f"the model lacks {', '.join(missing)}"
        form = "" if "equations" in table else "; with equations instead of F, G and H0"
        raise source.error((), came, needed=f"a model of the schema {SCHEMA}{form}")
