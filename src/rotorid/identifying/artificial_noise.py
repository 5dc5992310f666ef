r"""Identification repeated with artificial noise on the sensors: how far parameters move, next to the stated errors.

Each run adds white Gaussian noise to what the sensors measured, and identifies anew from the logs on: excitations,
responses or regressors, search and fit. So every kind of model has it, and it shows what a bootstrap does not: noise in
regressors, and choices that noise changes. A bootstrap draws anew the noise that a fit found
(:mod:`rotorid.uncertainty.bootstrapping`); here the user says how much more there is.

.. math:: y_k = y + \frac{\text{percent}}{100} \, \sigma_y \, n_k, \qquad n_k \sim N(0, 1)

with :math:`\sigma_y` the rms of the channel about its mean, over the maneuvers that were fitted.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rotorid.data.axes import ATTITUDE
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.identifying.methods import Method
from rotorid.io.pool import pool
from rotorid.results.model import IdentifiedModel, parameter_estimates
from rotorid.results.summary import (
    FailedRun,
    NoiseRuns,
    NoiseSpread,
    NoisyChannel,
    ParameterEstimate,
    RunSpread,
)
from rotorid.settings.identifying import NOISE_RUNS, IdentifySettings
from rotorid.typing import FloatArray
from rotorid.uncertainty.resampling import LeftOut, each_run

_PROGRESS = logging.getLogger("rotorid.progress")

MakeMethod = Callable[[Sequence[FlightRecord], IdentifySettings], Method[Any, Any]]
"""The method of a model for some logs; it must pickle, where there are workers."""

_MEASURED = re.compile(
    r"([pqr]|a[xyz])(_raw|_filtered)?|[pqruvw]_dot|phi|theta|psi|[uvw]|north|east|down"
    r"|velocity_(north|east|down|down_dot|forward|right)"
)
"""Channels of sensors and estimators of motion: what a model answers with. Commands, set-points and motors are none."""

_LOST = 0.05
_SHIFTED = 3.0


@dataclass(frozen=True)
class Run:
    """What one run gave: parameters, and how well the model fits."""

    parameters: Mapping[str, ParameterEstimate]
    cost: float | None
    fit_percent: Mapping[str, float]
    alone: Mapping[str, float]


@dataclass(frozen=True)
class NoisyFit:
    """An identification of logs with noise that a generator draws.

    Parameters
    ----------
    records
        Logs as they are.
    settings
        Choices of the run; the seed of its search is drawn too.
    make
        The method for the logs.
    stds
        Of each log, channel to the standard deviation of its noise.
    """

    records: tuple[FlightRecord, ...]
    settings: IdentifySettings
    make: MakeMethod
    stds: tuple[Mapping[str, float], ...]

    def __call__(self, rng: np.random.Generator) -> Run:
        """One run."""
        settings = replace(self.settings, seed=int(rng.integers(2**31)))
        noisy = [with_noise(record, stds, rng) for record, stds in zip(self.records, self.stds, strict=True)]
        method = self.make(noisy, settings)
        data = method.prepare(noisy)
        fitted = method.fit(data)
        fit = method.describe(data, fitted).fit
        alone = fit.search.alone.parameters if fit.search is not None and fit.search.alone is not None else {}
        return Run(
            parameters=parameter_estimates(fitted.listed, fitted.bounds),
            cost=None if fit.cost is None else fit.cost.average,
            fit_percent=dict(fit.fit_percent or {}),
            alone=dict(alone),
        )


def with_noise(record: FlightRecord, stds: Mapping[str, float], rng: np.random.Generator) -> FlightRecord:
    """A log with white Gaussian noise on some channels.

    Parameters
    ----------
    record
        The log.
    stds
        Channel to standard deviation, in its unit.
    rng
        Draws the noise: one row after the other, in the order of the log.
    """
    return replace(record, topics=tuple(_noisy(topic, stds, rng) for topic in record.topics))


def _noisy(topic: Topic, stds: Mapping[str, float], rng: np.random.Generator) -> Topic:
    rows = [row for row, channel in enumerate(topic.channels) if stds.get(channel.name, 0.0) > 0.0]
    if not rows:
        return topic
    values = topic.values.copy()
    for row in rows:
        values[row] += stds[topic.channels[row].name] * rng.standard_normal(topic.time_s.size)
    return replace(topic, values=values)


def rms_of_channels(
    record: FlightRecord, spans: Sequence[tuple[float, float]], also: Sequence[str]
) -> dict[str, float]:
    """Channels of sensors to their rms about the mean over some spans, or over the whole log without any.

    Parameters
    ----------
    record
        The log.
    spans
        Start and stop in seconds of the log.
    also
        Channels that count too, such as a model's own outputs.
    """
    found: dict[str, float] = {}
    for topic in record.topics:
        inside = np.zeros(topic.time_s.size, dtype=np.bool_) if spans else np.ones(topic.time_s.size, dtype=np.bool_)
        for start_s, stop_s in spans:
            inside |= (topic.time_s >= start_s) & (topic.time_s <= stop_s)
        for row, channel in enumerate(topic.channels):
            if channel.name in found or not (channel.name in also or _MEASURED.fullmatch(channel.name)):
                continue
            values = topic.values[row, inside]
            values = values[np.isfinite(values)]
            if values.size > 1:
                whole = np.unwrap(values) if channel.name in ATTITUDE else values
                found[channel.name] = float(np.std(whole))
    return found


def with_noise_runs(
    model: IdentifiedModel, records: Sequence[FlightRecord], settings: IdentifySettings, make: MakeMethod
) -> IdentifiedModel:
    """An identified model with the spread of runs with artificial noise.

    Parameters
    ----------
    model
        Identified from the logs as they are.
    records
        These logs.
    settings
        ``add_noise_percent``, ``runs``, ``seed`` and ``workers``.
    make
        The method for logs with noise.

    Raises
    ------
    InsufficientDataError
        Fewer than two runs gave a model; the findings name the reasons.
    """
    percent = settings.add_noise_percent
    assert percent is not None
    asked = settings.runs or NOISE_RUNS
    rms = [_rms(record, model) for record in records]
    stds = tuple({name: 0.01 * percent * value for name, value in own.items()} for own in rms)
    single = replace(settings, add_noise_percent=None, runs=None, workers=None, bootstrap=None)
    with pool(settings.workers) as workers:
        work = workers.shared(NoisyFit(tuple(records), single, make, stds))
        done = each_run(
            work, runs=asked, seed=settings.seed, executor=workers.executor, progress=partial(_say, percent)
        )
    runs = [(number, run) for number, run in enumerate(done, start=1) if not isinstance(run, LeftOut)]
    failed = tuple(
        FailedRun(run=number, reason=run.reason)
        for number, run in enumerate(done, start=1)
        if isinstance(run, LeftOut) and not run.stopped
    )
    stopped = any(isinstance(run, LeftOut) and run.stopped for run in done)
    if len(runs) < 2:
        reasons = "; ".join(dict.fromkeys(run.reason for run in failed))
        raise InsufficientDataError(
            f"{len(runs)} of {asked} runs with {percent:g} % of noise gave a model ({reasons})",
            needed="two or more",
            remedy="add less noise with --add-noise",
        )
    summary = NoiseRuns(
        percent=percent,
        runs=len(runs),
        asked=asked,
        seed=settings.seed,
        stopped=stopped,
        failed=failed,
        channels=_channels(records, rms, percent),
        parameters={
            name: spread
            for name, estimate in model.parameters.items()
            if estimate.status != "fixed"
            and (spread := _spread_of(estimate, [run.parameters.get(name) for _, run in runs])) is not None
        },
        alone=_rows([run.alone for _, run in runs]),
        cost=_over([run.cost for _, run in runs if run.cost is not None]),
        fit_percent=_rows([run.fit_percent for _, run in runs]),
        numbers=tuple(number for number, _ in runs),
        draws={
            name: tuple(run.parameters[name].value if name in run.parameters else None for _, run in runs)
            for name, estimate in model.parameters.items()
            if estimate.status != "fixed"
        },
    )
    asked_for = {"add_noise_percent": percent, "runs": asked}
    return replace(
        model,
        fit=replace(model.fit, noise_runs=summary),
        findings=(*model.findings, *judge_noise_runs(summary)),
        provenance=replace(model.provenance, settings={**model.provenance.settings, **asked_for}),
    )


def _say(percent: float, done: int, runs: int) -> None:
    _PROGRESS.info(
        f"identifying with {percent:g} % of noise: {done} of {runs} runs", extra={"done": done, "total": runs}
    )


def _rms(record: FlightRecord, model: IdentifiedModel) -> dict[str, float]:
    spans = [(one.start_s, one.stop_s) for one in model.provenance.maneuvers if one.record == record.source.name]
    return rms_of_channels(record, spans, model.fit.outputs)


def _channels(
    records: Sequence[FlightRecord], rms: Sequence[Mapping[str, float]], percent: float
) -> dict[str, NoisyChannel]:
    """Each channel with its unit; of several logs the mean square counts."""
    units = {channel.name: channel.unit for record in records for topic in record.topics for channel in topic.channels}
    found = {}
    for name in dict.fromkeys(name for own in rms for name in own):
        values = [own[name] for own in rms if name in own]
        mean = float(np.sqrt(np.mean(np.square(values))))
        found[name] = NoisyChannel(rms=mean, noise_std=0.01 * percent * mean, unit=units[name])
    return found


def _spread_of(estimate: ParameterEstimate, found: Sequence[ParameterEstimate | None]) -> NoiseSpread | None:
    """A parameter over the runs in which it was not dropped."""
    counted = [one for one in found if one is not None and one.status != "dropped"]
    if len(counted) < 2:
        return None
    values = np.array([one.value for one in counted])
    stated = [one.std_random for one in counted if one.std_random is not None]
    std = float(values.std(ddof=1))
    bias = float(values.mean()) - estimate.value
    return NoiseSpread(
        value=estimate.value,
        unit=estimate.unit,
        stated_std=estimate.std,
        stated_std_random=estimate.std_random,
        mean=float(values.mean()),
        std=std,
        bias=bias,
        bias_std=std / float(np.sqrt(values.size)),
        min=float(values.min()),
        max=float(values.max()),
        runs=values.size,
        stated_std_in_runs=float(np.sqrt(np.mean(np.square(stated)))) if stated else None,
    )


def _rows(tables: Sequence[Mapping[str, float]]) -> dict[str, RunSpread]:
    names = dict.fromkeys(name for table in tables for name in table)
    spreads = {name: _over([table[name] for table in tables if name in table]) for name in names}
    return {name: spread for name, spread in spreads.items() if spread is not None}


def _over(values: Sequence[float]) -> RunSpread | None:
    if len(values) < 2:
        return None
    array: FloatArray = np.asarray(values, dtype=np.float64)
    low, high = float(array.min()), float(array.max())
    return RunSpread(mean=float(array.mean()), std=float(array.std(ddof=1)), min=low, max=high)


def judge_noise_runs(runs: NoiseRuns) -> tuple[Finding, ...]:
    """What runs with noise say of a model: parameters that noise biases, and runs that are missing.

    Parameters
    ----------
    runs
        Their summary.

    Returns
    -------
    tuple of Finding
        ``noise_bias`` where a mean lies further from the value than chance and the stated error allow,
        ``noise_runs_incomplete`` where runs failed or were stopped.
    """
    findings = []
    for name, spread in runs.parameters.items():
        stated = spread.stated_std or 0.0
        if abs(spread.bias) > _SHIFTED * spread.bias_std and abs(spread.bias) > stated > 0.0:
            findings.append(
                warn(
                    "noise_bias",
                    name,
                    f"Noise of {runs.percent:g} % moves {name} by {abs(spread.bias) / stated:.1f} stated standard "
                    f"deviations ({spread.bias:+.3g} {spread.unit}). The noise of the log biases it too.",
                    bias=spread.bias,
                    bias_std=spread.bias_std,
                    stated_std=stated,
                )
            )
    if runs.failed:
        reasons = dict.fromkeys(run.reason for run in runs.failed)
        which = ", ".join(str(run.run) for run in runs.failed[:5]) + (", …" if len(runs.failed) > 5 else "")
        findings.append(
            (warn if len(runs.failed) > _LOST * runs.asked else remark)(
                "noise_runs_incomplete",
                "--add-noise",
                f"{len(runs.failed)} of {runs.asked} runs with noise gave no model (run {which}): "
                f"{next(iter(reasons))} The others are counted.",
                failed=len(runs.failed),
            )
        )
    if runs.stopped:
        findings.append(
            remark(
                "noise_runs_incomplete",
                "--add-noise",
                f"Stopped after {runs.runs + len(runs.failed)} of {runs.asked} runs with noise; these are counted.",
                runs=runs.runs,
            )
        )
    return tuple(findings)
