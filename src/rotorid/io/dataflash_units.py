"""Units of DataFlash columns, from the ``UNIT``, ``MULT`` and ``FMTU`` messages of the log."""

from __future__ import annotations

from collections.abc import Mapping

from rotorid.io.dataflash_formats import LETTERS, Format, Table

PREFIXES: Mapping[float, str] = {0.0: "", 1.0: "", 1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "µ", 1e-9: "n"}


def units_of(tables: Mapping[str, Table]) -> Mapping[int, Mapping[str, str]]:
    """Type of message to the unit of each of its columns, for the values as ``Table.column`` returns them.

    A multiplier becomes a prefix of the unit (``cm/s``), or a number in front of it (``100 m``) when no prefix fits.
    The letters that carry a factor themselves are already scaled, so that their multiplier is left out.
    """
    if not {"FMTU", "UNIT"} <= tables.keys():
        return {}
    labels = _lookup(tables["UNIT"], "Label")
    multipliers = _lookup(tables["MULT"], "Mult") if "MULT" in tables else {}
    formats = {table.format.number: table.format for table in tables.values()}
    declared = tables["FMTU"]
    if not (declared.holds_numbers("FmtType") and declared.holds_text("UnitIds", "MultIds")):
        return {}
    rows = zip(*(declared.column(name).tolist() for name in ("FmtType", "UnitIds", "MultIds")), strict=True)
    return {
        number: _columns(formats[number], unit_ids, mult_ids, labels, multipliers)
        for number, unit_ids, mult_ids in rows
        if number in formats
    }


def _lookup(table: Table, column: str) -> Mapping[str, object]:
    if column not in table or not table.holds_numbers("Id") or table.column("Id").dtype.kind not in "iu":
        return {}
    return {
        chr(key & 0xFF): value
        for key, value in zip(table.column("Id").tolist(), table.column(column).tolist(), strict=True)
    }


def _columns(
    layout: Format, unit_ids: str, mult_ids: str, labels: Mapping[str, object], multipliers: Mapping[str, object]
) -> Mapping[str, str]:
    units = {}
    for index, (column, letter) in enumerate(zip(layout.columns, layout.letters, strict=False)):
        label = str(labels.get(unit_ids[index : index + 1], ""))
        multiplier = multipliers.get(mult_ids[index : index + 1])
        if label and LETTERS[letter].divisor == 1.0 and isinstance(multiplier, float):
            # The log stores single-precision numbers in a double: seven digits are what was meant.
            rounded = float(f"{multiplier:.7g}")
            label = PREFIXES[rounded] + label if rounded in PREFIXES else f"{rounded:.4g} {label}"
        if label:
            units[column] = label
    return units
