"""What commands answer on real and simulated logs, down to every number, before and after a change of the code.

``python -m tests.golden.results --compare`` runs all cases and compares them with ``results.json`` beside this file;
``--write`` writes that file anew, for a change that is meant. Names of cases after it limit either. The logs are those
of the folder ``ROTORID_DATA``.

Only the public command line is used, as ``python -m rotorid`` does, but inside this process, so that what is compiled
is compiled once. Of an answer are kept the exit code, the names of the files that were written, which of them holds
what was printed, and the JSON object on standard output, without what a run owes to its surroundings: version, command,
and hashes of the results that it read.

Two answers are the same if their keys, texts, flags and counts are, and their lists in order, findings among them.
Numbers may differ by rounding, because the same sums in another order are the same method: :func:`tolerance` says by
how much. Cases are such that rounding decides nothing: no parameter that the data do not show at all, whose standard
deviation would be rounding over rounding, and no choice between two minima or two ranks that lie within rounding.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import resource
import runpy
import sys
import tempfile
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias
from unittest import mock

GOLDEN = Path(__file__).with_name("results.json")
DATA = Path(os.environ.get("ROTORID_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))

Json: TypeAlias = Any
"""What a JSON text says: dictionaries, lists, texts, numbers, flags and ``None``."""

DIGITS = 8
LINE = 200
LONGEST_LIST = 60
"""Longer lists of numbers are kept as their length, mean, root mean square and ends."""

ROUNDING = 1e-6
"""Of a number, or of its standard deviation if that is larger.

A search ends where a step would lower the cost by less than 1e-10 of it: with N residuals within 1e-5 sqrt(N) standard
deviations of the minimum, and much closer, as its steps converge quadratically. Without fused multiplications and with
the linear algebra of an older processor the numbers of these cases move by up to 2e-9, and those of the bootstrap, with
its many searches, by 1e-7. Ten times that is still a millionth of what matters.
"""
LEAST = 1e-12
"""Of numbers that are zero but for rounding, such as the rise of a cost that does not rise."""


class Case(NamedTuple):
    """A command as a person types it.

    ``@log`` stands for a file of the data folder, ``%case`` for the folder that another case wrote.
    """

    command: str
    slow: bool = False

    def arguments(self, data: Path, work: Path) -> list[str]:
        """Words of the command with its files in their places."""
        places = {"@": data, "%": work}
        return [str(places[word[0]] / word[1:]) if word[0] in places else word for word in self.command.split()]

    @property
    def needs(self) -> list[str]:
        """Cases whose results this one reads."""
        return [word[1:] for word in self.command.split() if word.startswith("%")]


_PX4 = "@px4_sitl/roll.ulg @px4_sitl/pitch.ulg.xz @px4_sitl/yaw.ulg.xz @px4_sitl/thrust.ulg.xz"
_LONGITUDINAL = "@s500/pitch_sweeps.csv @s500/thrust_sweeps.csv --model hover.longitudinal"
_HEAVE_ALONE = "--fix M_u=0 --fix M_w=0 --fix X_q=0 --fix X_w=0 --fix Z_q=0 --fix Z_u=0"
_INPUTS_APART = "--fix M_thrust=0 --fix X_thrust=0 --fix Z_pitch=0"
_PRBS = "@antx/prbs.mat --map @antx/map.toml --segment pitch:50:76 --band 8:80"
_TWO_UNFILTERED = "@bebop/unfiltered/120935.mat @bebop/unfiltered/121028.mat --map @bebop/map.toml"

CASES: dict[str, Case] = {
    # frequency responses, with all kinds of models, autopilots and searches
    "rate_ardupilot": Case("identify @ardupilot_sitl/x_calm_roll.BIN --model rate.roll"),
    "rate_px4_bootstrap": Case("identify @px4_sitl/roll.ulg --model rate.roll --bootstrap 200 --seed 1"),
    "rate_betaflight": Case("identify @betaflight/smooth_tune.BBL --model rate.roll --segment roll:20:60"),
    "rate_search": Case(f"identify {_PRBS} --model rate.pitch --search evolution --evaluations 500 --seed 3"),
    "transfer": Case(f"identify {_PRBS} --model transfer:0/2 --inputs pitch_command --outputs q"),
    "axis_cifer": Case("identify @px4_sitl/yaw.ulg.xz --model axis.yaw --weights cifer"),
    "axis_wind": Case("identify @ardupilot_sitl/x_wind_rollpitch.BIN.xz --model axis.pitch", slow=True),
    "longitudinal_reduced": Case(f"identify {_LONGITUDINAL} --reduce --verify @s500/pitch_doublets.csv", slow=True),
    "longitudinal_two_step": Case(
        "identify @px4_sitl/pitch.ulg.xz @px4_sitl/thrust.ulg.xz --model hover.longitudinal --speed-damping two_step "
        f"{_HEAVE_ALONE} {_INPUTS_APART}",
        slow=True,
    ),
    "lateral": Case("identify @s500/roll_sweeps.csv @s500/yaw_sweeps.csv --model hover.lateral", slow=True),
    "full": Case(f"identify {_PX4} --model hover.full", slow=True),
    # the other methods
    "output_error": Case("identify @ardupilot_sitl/x_calm_roll.BIN --model rate.roll --method output_error"),
    "prediction_error": Case(
        "identify @ardupilot_sitl/x_wind_yawthrust.BIN.xz --model rate.yaw --method prediction_error"
    ),
    "prediction_error_longitudinal": Case(f"identify {_LONGITUDINAL} --method prediction_error", slow=True),
    "equation_error": Case(f"identify {_LONGITUDINAL} --method equation_error", slow=True),
    "responses_crossed": Case(f"identify {_TWO_UNFILTERED} --model response.first_order_delay --cross-validate each"),
    "black_box_second": Case(
        "identify @bebop/ident/120935.mat --map @bebop/map.toml --model black_box:2 --decoupled "
        "--inputs phi_setpoint,theta_setpoint --outputs phi,theta"
    ),
    "black_box_third": Case(
        "identify @bebop/ident/122633.mat --map @bebop/map.toml --model black_box:3 "
        "--inputs theta_setpoint --outputs theta"
    ),
    # the physics of motors
    "motors_px4": Case(f"identify {_PX4} --model physical.motors --fix m=1 --fix kappa=0.02 --arm 0.283", slow=True),
    "motors_ardupilot": Case(
        "identify @ardupilot_sitl/x_calm_roll.BIN @ardupilot_sitl/x_calm_thrust.BIN.xz "
        "--model physical.motors --fix m=3 --arm 0.35",
        slow=True,
    ),
    "motors_crazyflie": Case(
        "identify @crazyflie/log10 --model physical.motors --fix m=0.027 --fix tau_accel=0 --segment thrust:35:65"
    ),
    # what the data cannot support
    "refused_only_short": Case("identify @ardupilot/erle_brain3.BIN --model rate.roll"),
    "refused_inverse_controller": Case("identify @px4/zmr250 --model rate.yaw --segment yaw:10:60"),
    # the other commands
    "response": Case("response @ardupilot_sitl/x_calm_roll.BIN --inputs roll_command --outputs p,ay"),
    "delay": Case(f"delay {_TWO_UNFILTERED} --input phi_setpoint --output phi"),
    "verify": Case("verify %rate_ardupilot @ardupilot_sitl/x_calm_verify.BIN.xz"),
    "compare": Case("compare %rate_ardupilot %output_error --log @ardupilot_sitl/x_calm_verify.BIN.xz"),
}


def run(name: str, data: Path, work: Path) -> dict[str, Json]:
    """The answer of a case, which stands in a folder of its name below ``work`` as well."""
    case, folder = CASES[name], work / name
    for needed in case.needs:
        if not (work / needed).is_dir():
            run(needed, data, work)
    code, out, error = command([*case.arguments(data, work), "--json", "--out", str(folder)])
    files = sorted(folder.iterdir()) if folder.is_dir() else []
    printed = [file.name for file in files if file.suffix == ".json" and file.read_text(encoding="utf-8") == out]
    answer = {"exit": code, "files": [file.name for file in files], "printed": printed}
    return answer | ({"result": kept(json.loads(out))} if out else {"error": error.rstrip().rpartition("\n")[2]})


def command(words: Sequence[str]) -> tuple[int, str, str]:
    """Exit code and streams of ``python -m rotorid WORDS``, inside this process."""
    out, error, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(error), mock.patch.object(sys, "argv", ["rotorid", *words]):
        try:
            runpy.run_module("rotorid", run_name="__main__")
        except SystemExit as ended:
            code = int(ended.code or 0)
        except Exception:  # as Python itself ends a program, so that the other cases still run
            code = 1
            traceback.print_exc()
    return code, out.getvalue(), error.getvalue()


def kept(document: dict[str, Json]) -> dict[str, Json]:
    """An answer without what it owes to its surroundings, its numbers rounded and its long lists summed up."""
    provenance = {name: part for name, part in document["provenance"].items() if name not in ("version", "command")}
    results = {name: None for name in provenance["inputs"] if name.endswith("result.json")}
    provenance["inputs"] = provenance["inputs"] | results
    # Minima that do not count end where rounding lets them; the nearest one is enough.
    minima = {"minima": document["minima"][:1]} if "minima" in document else {}
    short: dict[str, Json] = _short(document | {"provenance": provenance} | minima)
    return short


def _short(value: Json) -> Json:
    if isinstance(value, dict):
        return {name: _short(part) for name, part in value.items()}
    if isinstance(value, list):
        numbers = all(isinstance(part, float) for part in value)
        return _summed_up(value) if numbers and len(value) > LONGEST_LIST else [_short(part) for part in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _summed_up(numbers: Sequence[float]) -> dict[str, Json]:
    count = len(numbers)
    mean, power = (math.fsum(number**exponent for number in numbers) / count for exponent in (1, 2))
    return {"count": count, "mean_rms_ends": _short([mean, math.sqrt(power), numbers[0], numbers[-1]])}


class Difference(NamedTuple):
    """Where two answers differ, in what, and how many tolerances that is where it is a number."""

    where: str
    before: Json
    after: Json
    tolerances: float = math.inf

    def __str__(self) -> str:
        return f"{self.where}: {_said(self.before)} became {_said(self.after)}"


def _said(value: Json) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LINE else text[:LINE] + " ..."


def differences(before: Json, after: Json) -> list[Difference]:
    """All places where an answer is not what it was."""
    return [found for found in compared(before, after) if found.tolerances > 1.0]


def compared(before: Json, after: Json, where: str = "", largest: float = 0.0) -> Iterator[Difference]:
    """Every number of both with its distance in tolerances, and everything else that differs."""
    if isinstance(before, dict) and isinstance(after, dict):
        for name in sorted(before.keys() ^ after.keys()):
            yield Difference(f"{where}/{name}", before.get(name, "nothing"), after.get(name, "nothing"))
        for name in before:
            if name in after:
                yield from compared(before[name], after[name], f"{where}/{name}", spread(before, name))
    elif isinstance(before, list) and isinstance(after, list):
        kinds = [[part.get("kind") for part in side if isinstance(part, dict)] for side in (before, after)]
        if len(before) != len(after) or kinds[0] != kinds[1]:
            yield Difference(where, *(kinds if any(kinds[0] + kinds[1]) else (before, after)))
            return
        size = max([largest, *(abs(part) for part in before if isinstance(part, float))])
        for row, parts in enumerate(zip(before, after, strict=True)):
            yield from compared(*parts, f"{where}/{row}", size)
    elif isinstance(before, float) and isinstance(after, int | float) and not isinstance(after, bool):
        yield Difference(where, before, after, abs(after - before) / tolerance(before, largest))
    elif before != after:
        yield Difference(where, before, after)


def tolerance(value: float, largest: float = 0.0) -> float:
    """How far a number may move, ``largest`` being its standard deviation or the largest of its list.

    Examples
    --------
    >>> tolerance(-2.0, 0.1), tolerance(0.0, 0.1)
    (2e-06, 1e-07)
    """
    return max(ROUNDING * max(abs(value), largest), LEAST)


def spread(parent: Mapping[str, Json], name: str) -> float:
    """Standard deviation of a number that stands beside it, in its unit; zero where there is none.

    A percentage of a value moves with it, so that it inherits its relative spread.

    Examples
    --------
    >>> pole = {"real": -2.0, "real_std": 0.1, "imag": 1.0}
    >>> spread(pole, "real"), spread(pole, "imag")
    (0.1, 0.0)
    >>> spread({"value": -2.0, "std": 4.0, "insensitivity_percent": 80.0}, "insensitivity_percent")
    160.0
    """
    number, value, std = (parent.get(key) for key in (name, "value", "std"))
    if not isinstance(number, float):
        return 0.0
    if name == "cost_rise":
        # The difference of two costs, of which two are told apart where they differ by one.
        return 1.0
    if name.endswith("_percent") and value and std:
        return float(abs(number * std / value))
    first, _, unit = name.partition("_")
    own = (f"{first}_std_{unit}" if unit else f"{first}_std", "std_s" if name.endswith("_s") else "std")
    return max((float(parent[key]) for key in own if isinstance(parent.get(key), float)), default=0.0)


def written(answers: Mapping[str, Json]) -> str:
    """Answers as JSON text: what fits on a line stands on one."""
    return _text(answers, 0) + "\n"


def _text(value: Json, depth: int) -> str:
    line = json.dumps(value, ensure_ascii=False)
    if depth + len(line) <= LINE or not isinstance(value, dict | list):
        return line
    if isinstance(value, dict):
        parts = [f"{json.dumps(name)}: {_text(part, depth + 1)}" for name, part in value.items()]
    else:
        parts = [_text(part, depth + 1) for part in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{' ' * (depth + 1)}" + f",\n{' ' * (depth + 1)}".join(parts) + f"\n{' ' * depth}{closing}"


def known() -> dict[str, Json]:
    """Answers as they were written down."""
    answers: dict[str, Json] = json.loads(GOLDEN.read_text(encoding="utf-8"))
    return answers


def cpu_s() -> float:
    """Seconds of processor time of this process and of those that it started and that have ended."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def main() -> None:
    """Run cases by hand, with a line for each."""
    parser = argparse.ArgumentParser(description="Answers of commands on real logs, as they were and as they are.")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", action="store_true", help="write the answers down")
    what.add_argument("--compare", action="store_true", help="compare them with those that were written down")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"all, or some of: {', '.join(CASES)}")
    options = parser.parse_args()
    if wrong := set(options.cases) - set(CASES):
        parser.error(f"no such case: {', '.join(sorted(wrong))}")
    if not DATA.is_dir():
        parser.error(f"no flight data at {DATA}; set ROTORID_DATA to their folder")
    answers = known() if GOLDEN.exists() else {}
    found: dict[str, list[Difference]] = {}
    with tempfile.TemporaryDirectory() as work:
        for name in options.cases or CASES:
            start_s = cpu_s()
            answer = run(name, DATA, Path(work))
            took = f"{name:32} {cpu_s() - start_s:6.1f} s  exit {answer['exit']}"
            if options.write:
                answers[name] = answer
                print(took, flush=True)
            else:
                looked_at = list(compared(answers.get(name), answer))
                found[name] = [one for one in looked_at if one.tolerances > 1.0]
                moved = max((one.tolerances for one in looked_at), default=0.0)
                same = f"same, numbers moved by up to {moved:.1g} tolerances"
                print(f"{took}  {f'{len(found[name])} differences' if found[name] else same}", flush=True)
    if options.write:
        GOLDEN.write_text(written({name: answers[name] for name in CASES if name in answers}), encoding="utf-8")
    for name, ones in found.items():
        for one in sorted(ones, reverse=True, key=lambda one: one.tolerances):
            print(f"{name}{one}")
    sys.exit(1 if any(found.values()) else 0)


if __name__ == "__main__":
    main()
