"""Properties of models as text: whatever can be written is read back as it was."""

from __future__ import annotations

import contextlib
from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.errors import ModelError
from rotorid.models.description import from_toml, to_toml
from rotorid.models.entry import Entry
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.rate import rate_model
from rotorid.models.structure import LinearStructure

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.from_regex(r"[A-Za-z_]\w{0,8}", fullmatch=True)
TEXTS = st.text(st.characters(codec="utf-8"), max_size=20)
ENTRIES = st.builds(Entry, constant=NUMBERS, terms=st.lists(st.tuples(NAMES, NUMBERS), max_size=4).map(tuple))


@given(ENTRIES)
def test_an_entry_reads_back_as_it_was_written(entry: Entry) -> None:
    assert Entry.parse(str(entry)) == entry


@given(st.text(alphabet="0123456789.eE+-* abL_p", max_size=12))
def test_an_entry_is_read_to_the_last_sign_or_refused(text: str) -> None:
    try:
        entry = Entry.parse(text)
    except ModelError:
        return
    assert Entry.parse(str(entry)) == entry


@given(value=NUMBERS, unit=TEXTS, name=TEXTS, source=TEXTS, parameter=NAMES)
@settings(max_examples=60)
def test_a_model_reads_back_as_it_was_written(value: float, unit: str, name: str, source: str, parameter: str) -> None:
    one, zero = Entry.parse(1), Entry()
    structure = LinearStructure(
        name=name,
        inputs=(f"{name} in",),
        states=(unit,),
        outputs=(source,),
        M=((one,),),
        F=((Entry.parse(-1),),),
        G=((Entry.parse(parameter),),),
        H0=((one,),),
        H1=((zero,),),
        input_delays=(zero,),
        output_delays=(zero,),
        parameters=ParameterSet((Parameter(name=parameter, value=value, unit=unit),)),
        gain=parameter,
        source=source,
    )
    again = from_toml(to_toml(structure, structure.parameters, {parameter: abs(value)}))
    for field in ("name", "inputs", "states", "outputs", "G", "parameters", "gain", "source"):
        assert getattr(again, field) == getattr(structure, field), field


@given(st.data())
@settings(max_examples=150)
def test_a_damaged_text_gives_a_model_or_a_sentence(data: st.DataObject) -> None:
    structure = rate_model("rate.roll")
    text = to_toml(structure, structure.parameters, {})
    start = data.draw(st.integers(0, len(text)))
    stop = data.draw(st.integers(start, min(start + 12, len(text))))
    damaged = text[:start] + data.draw(TEXTS) + text[stop:]
    # Any other error than a ModelError ends the test.
    with contextlib.suppress(ModelError):
        assert from_toml(damaged).parameters.names


@given(st.permutations(["L_roll", "L_p", "T_motor", "tau_roll"]), st.lists(NUMBERS, min_size=4, max_size=4))
def test_the_order_of_parameters_does_not_change_the_system(order: list[str], values: list[float]) -> None:
    structure = rate_model("rate.roll")
    shuffled = replace(structure, parameters=ParameterSet(tuple(structure.parameters[name] for name in order)))
    point = dict(zip(structure.parameters.names, values, strict=True))
    one, other = structure.matrices(point), shuffled.matrices(point)
    for field in ("M", "F", "G", "H0", "H1", "input_delays_s", "output_delays_s"):
        assert (getattr(one, field) == getattr(other, field)).all()
