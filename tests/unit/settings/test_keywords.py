"""A program sees options as keywords: in the signature of each verb, and in its errors."""

from __future__ import annotations

import inspect
import pickle
import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rotorid
from rotorid.errors import InsufficientDataError, RotoridError, UsageError
from rotorid.exports import ExportSettings
from rotorid.fleets import FleetSettings
from rotorid.identifying.identification import identify
from rotorid.models.rotors import library_layout
from rotorid.proposing import TuneSettings
from rotorid.reviewing import ReviewSettings
from rotorid.settings import IdentifySettings, VerifySettings
from rotorid.settings.keywords import in_keywords, settings_of

NAMES: list[str] = rotorid.__all__  # type: ignore[attr-defined]
VERBS = [name for name in NAMES if settings_of(inspect.unwrap(getattr(rotorid, name))) is not None]


def test_every_verb_with_options_is_one() -> None:
    assert {"compare", "delay", "fleet", "identify", "identify_several", "response"} < {*VERBS}
    assert {"review", "simulate", "stitch", "track", "tune", "verify"} < {*VERBS}
    for name in NAMES:
        found = getattr(rotorid, name)
        if inspect.isfunction(found):
            kinds = {parameter.kind for parameter in inspect.signature(found).parameters.values()}
            assert inspect.Parameter.VAR_KEYWORD not in kinds, f"{name} hides its options"


@pytest.mark.parametrize("name", VERBS)
def test_the_signature_of_a_verb_has_each_field_of_its_settings(name: str) -> None:
    verb = getattr(rotorid, name)
    kind = settings_of(inspect.unwrap(verb))
    assert kind is not None
    parameters = inspect.signature(verb).parameters
    for item in fields(kind):
        assert item.name in parameters, item.name
        assert parameters[item.name].kind is not inspect.Parameter.VAR_KEYWORD


@pytest.mark.parametrize(
    ("kind", "words", "shown"),
    [
        (IdentifySettings, "add --segment roll:5.00:35.00.", 'add segments="roll:5.00:35.00".'),
        (IdentifySettings, "use --reduce, or --search NAME", 'use reduce=True, or search="NAME"'),
        (IdentifySettings, "narrow --band", "narrow band_rad_s"),
        (
            IdentifySettings,
            "use --speed-damping two_step_force, or joint",
            'use speed_damping="two_step_force", or joint',
        ),
        (IdentifySettings, "--method and --runs need logs", "method and runs need logs"),
        (IdentifySettings, "choose one with --model, or --model all", 'choose one with model, or model="all"'),
        (IdentifySettings, "add --verify LOG", 'add verify="LOG"'),
        (VerifySettings, "see rotorid verify RESULT LOG --scale 8", "see rotorid verify RESULT LOG --scale 8"),
        (VerifySettings, "give --layout", "give --layout (rotorid identify)"),
        (ReviewSettings, "left out (--no-models)", "left out (models=False)"),
        (TuneSettings, "no options here", "no options here"),
        (FleetSettings, "", ""),
        (
            IdentifySettings,
            "run rotorid design sweep --axis roll --band 1:30, or widen --band",
            "run rotorid design sweep --axis roll --band 1:30, or widen band_rad_s",
        ),
        (ExportSettings, "use --delay-as-lag instead of --pade", 'use delay="lag" instead of pade_order'),
        (None, "fix some with --fix NAME=VALUE", "fix some with --fix NAME=VALUE (rotorid identify)"),
    ],
)
def test_options_become_keywords(kind: type | None, words: str, shown: str) -> None:
    assert in_keywords(words, kind) == shown


def test_an_error_speaks_to_its_caller() -> None:
    with pytest.raises(UsageError, match="--pieces -1 is not a length"):
        identify("flight.ulg", "rate.roll", pieces_s=-1.0)
    with pytest.raises(UsageError) as error:
        rotorid.identify("flight.ulg", "rate.roll", pieces_s=-1.0)
    assert str(error.value) == "pieces_s=-1 is not a length; expected more than 0 s."
    assert error.value.came == "pieces_s=-1 is not a length"
    with pytest.raises(RotoridError, match="has more than one of fix, ties and free"):
        rotorid.identify("flight.ulg", "rate.roll", fix="L_p=1", free="L_p")


def test_functions_without_options_speak_of_their_arguments(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    path.write_text("a,b\n0,1\n1,2\n")
    with pytest.raises(RotoridError, match=r'with a mapping: mapping="FILE.toml"\.$'):
        rotorid.read(path)
    with pytest.raises(RotoridError, match=r'with a mapping: mapping="FILE.toml"\.$'):
        rotorid.FlightRecord.from_arrays([0.0, 1.0], {"b": [1.0, 2.0]})
    with pytest.raises(RotoridError, match='use delay="lag" instead of pade_order'):
        rotorid.export([], "rl-tools", ExportSettings(pade_order=3))
    with pytest.raises(RotoridError, match=r'mujoco needs .*; add given=\{"m": KG, "I_xx": NUMBER, .*"c_1": NUMBER\}'):
        rotorid.export([], "mujoco", layout=library_layout("quad.x"))


def test_steps_refuse_what_is_no_record_no_axis_and_no_rate() -> None:
    record = rotorid.FlightRecord.from_arrays([0.0, 0.1], {"p": [0.0, 1.0]})
    span = {"channels": ["p"], "start_s": 0.0, "stop_s": 0.1}
    calls: list[tuple[Callable[[], object], str]] = [
        (lambda: rotorid.find_excitations("flight.ulg", "roll"), "str is no FlightRecord; expected what rotorid.read"),  # type: ignore[arg-type]
        (lambda: rotorid.resample("flight.ulg", **span), "str is no FlightRecord; expected what rotorid.read gave"),  # type: ignore[arg-type]
        (lambda: rotorid.find_excitations(record, "rol"), "unknown axis 'rol'; did you mean roll?"),  # type: ignore[arg-type]
        (lambda: rotorid.resample(record, **span, sample_rate_hz=-3.0), "sample rate -3 Hz is not positive"),  # type: ignore[arg-type]
        (lambda: rotorid.identify("a.ulg", "rate.roll", fix={"T_motor": "x"}), "fix of T_motor is the text 'x'; exp"),  # type: ignore[dict-item]
    ]
    for call, words in calls:
        with pytest.raises(UsageError, match=re.escape(words)):
            call()


def test_what_a_command_prints_below_is_in_the_findings_of_the_error() -> None:
    unsupported = rotorid.FlightRecord.from_arrays([0.0, 0.1], {"p": [0.0, 1.0]})
    with pytest.raises(InsufficientDataError, match="see the findings of this error for what each axis needs") as error:
        rotorid.tune(records=unsupported)
    assert {finding.kind for finding in error.value.findings} >= {"not_tuned"}


def test_verbs_go_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(rotorid.identify)) is rotorid.identify
    assert inspect.unwrap(rotorid.identify) is identify


def test_a_simulation_takes_texts_and_suggests_names() -> None:
    with pytest.raises(TypeError, match="did you mean duration_s"):
        rotorid.simulate("x500", duraton_s=0.05)  # type: ignore[call-arg]
    with pytest.raises(RotoridError, match="no number of a vehicle 'weight'"):
        rotorid.simulate("x500", duration_s=0.05, changes="weight=2")
    with pytest.raises(UsageError, match=r"wind='3' is no Wind; expected rotorid.Wind\(north_m_s=3.0\)"):
        rotorid.simulate("x500", duration_s=0.05, wind="3")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="int is no vehicle; expected a name such as x500, or an Aircraft"):
        rotorid.simulate(5, duration_s=0.05)  # type: ignore[arg-type]


WRONG_LOGS = [
    ([], "no log was given; expected at least one flight log"),
    (None, "NoneType is no flight log; expected a file or a FlightRecord"),
    ([5.0], "float is no flight log; expected a file or a FlightRecord"),
    ({"roll": "flight.ulg"}, "dict is no flight log"),
    (SimpleNamespace(columns=["time [s]", "p"]), "is no flight log; .* make one with FlightRecord.from_pandas"),
]


@pytest.mark.parametrize(("logs", "words"), WRONG_LOGS)
@pytest.mark.parametrize("name", ["delay", "identify", "identify_several", "inspect", "response", "review", "track"])
def test_what_is_no_log_is_said_by_its_type(name: str, logs: object, words: str) -> None:
    models: dict[str, list[Any]] = {"identify": ["rate.roll"], "identify_several": [["rate.roll"]]}
    with pytest.raises(UsageError, match=words):
        getattr(rotorid, name)(logs, *models.get(name, []))


def test_a_verb_of_one_log_takes_no_two() -> None:
    record = rotorid.FlightRecord.from_arrays([0.0, 0.1], {"p": [0.0, 1.0]})
    for verb in (rotorid.inspect, rotorid.track):
        with pytest.raises(UsageError, match="2 logs were given; expected one log"):
            verb([record, record])  # type: ignore[arg-type]


def test_what_is_no_model_is_said() -> None:
    """A folder, as the command line takes it, is read first; ``tune`` takes logs by keyword."""
    folder = r"'rotorid-out/a' is no identified model; read a result with rotorid.load"
    calls: list[Callable[[Any], object]] = [
        lambda model: rotorid.compare([model, model]),
        lambda model: rotorid.export(model, "control"),
        lambda model: rotorid.joined_model([model, model]),
        lambda model: rotorid.stitch({"hover": model}),
        rotorid.tune,
    ]
    for call in calls:
        with pytest.raises(UsageError, match=folder):
            call("rotorid-out/a")
        with pytest.raises(UsageError, match="NoneType is no identified model; expected what"):
            call(None)
    with pytest.raises(UsageError, match="and give logs as records="):
        rotorid.tune("flight.ulg")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="list has no names of models; expected a dictionary of names to results"):
        rotorid.stitch([])  # type: ignore[arg-type]
