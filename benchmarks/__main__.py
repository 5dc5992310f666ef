"""All benchmarks in one table: ``python -m benchmarks``. Ratios are compared with their bars; times only inform."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks import (
    accuracy,
    commands,
    dataflash,
    flight,
    frequency_response,
    genetic,
    output_error,
    state_space,
    ulog,
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One job: seconds of ours and of the peer, and how many times faster ours must be."""

    job: str
    ours_s: float
    peer: str
    peer_s: float
    bar: float

    @property
    def ratio(self) -> float:
        return self.peer_s / self.ours_s

    def __str__(self) -> str:
        verdict = "met" if self.ratio >= self.bar else "MISSED"
        return (
            f"{self.job:44} {self.ours_s:9.3f} {self.peer:>12} {self.peer_s:9.3f} "
            f"{self.ratio:8.0f} {self.bar:6.0f}  {verdict}"
        )


def rows() -> Iterator[Row | str]:
    """Results as they come, and a sentence for what was skipped."""
    for rate_hz in frequency_response.RATES_HZ:
        result = frequency_response.run(rate_hz)
        yield Row(
            job=f"spectra of 4 x 9 pairs, 600 s at {rate_hz:.0f} Hz",
            ours_s=result["rotorid_s"],
            peer="scipy, each pair",
            peer_s=result["scipy_s"],
            bar=frequency_response.BAR,
        )
        memory, limit = result["memory_gib"], frequency_response.MEMORY_BAR_GIB
        yield f"  without scipy.signal.coherence, formed from the densities instead: {result['ratio_densities']:.0f}"
        yield f"  against one NumPy transform for each channel and window length: {result['ratio_numpy']:.1f}"
        yield f"  memory {memory:.2f} GiB of {limit:.0f} GiB: {'met' if memory < limit else 'MISSED'}"
    yield from _fits()
    yield from _output_error()
    yield from _flights()
    yield from _accuracy()
    yield from _searches()
    yield from _commands()
    missing = [log.name for log in (dataflash.LOG, ulog.LOG) if not log.is_file()]
    if missing:
        yield f"logs skipped: there is no {' and no '.join(missing)}; set ROTORID_DATA to the folder of flight data"
        return
    result = dataflash.run()
    yield Row(
        job=f"DataFlash, {result['log_mb']:.0f} MB, every column",
        ours_s=result["rotorid_s"],
        peer="pymavlink",
        peer_s=result["pymavlink_s"],
        bar=100.0,
    )
    result = ulog.run()
    yield Row(
        job=f"ULog, {result['log_mb']:.0f} MB, a record against all topics",
        ours_s=result["rotorid_s"],
        peer="pyulog",
        peer_s=result["pyulog_s"],
        bar=1.0,
    )


def _fits() -> Iterator[Row | str]:
    if not state_space.AVAILABLE:
        yield state_space.SKIPPED
        return
    for job in (state_space.small(), state_space.large()):
        result = state_space.run(job)
        yield Row(
            job=f"frequency fit, {job.name}",
            ours_s=result["rotorid_s"],
            peer="control",
            peer_s=result["control_s"],
            bar=job.bar,
        )
        yield Row(
            job=f"the same from {state_space.STARTS} starts",
            ours_s=result["rotorid_starts_s"],
            peer="control",
            peer_s=result["control_starts_s"],
            bar=state_space.STARTS_BAR,
        )


def _output_error() -> Iterator[Row]:
    job = output_error.job()
    result = output_error.run(job)
    yield Row(
        job="output error, residual and Jacobian",
        ours_s=result["rotorid_s"],
        peer="lsim",
        peer_s=result["lsim_s"],
        bar=output_error.JACOBIAN_BAR,
    )
    yield Row(
        job="output error, whole fit",
        ours_s=result["rotorid_fit_s"],
        peer="lsim",
        peer_s=result["lsim_fit_s"],
        bar=output_error.FIT_BAR,
    )


def _flights() -> Iterator[Row | str]:
    result = flight.run()
    yield Row(
        job=f"nonlinear flight, {flight.DURATION_S:.0f} s, equations alone",
        ours_s=result["rotorid_s"],
        peer="solve_ivp",
        peer_s=result["solve_ivp_s"],
        bar=flight.RATIO_BAR,
    )
    yield (
        f"  errors {result['rotorid_error']:.0e} and {result['solve_ivp_error']:.0e} rad/s: solve_ivp at the loosest "
        f"tolerance that is no worse; against Runge and Kutta in NumPy with steps as ours, at an error of "
        f"{result['numpy_error']:.0e} rad/s: {result['numpy_s'] / result['rotorid_s']:.0f}"
    )
    rates = flight.batch()
    for what in ("equations alone", "whole flights"):
        verdict = "met" if rates[what] >= flight.BATCH_BAR else "MISSED"
        yield f"  simulated seconds per core-second, {what}: {rates[what]:.0f} | {flight.BATCH_BAR:.0f} {verdict}"


def _searches() -> Iterator[Row | str]:
    found = genetic.run()
    for ours, peer, bar in genetic.MATCHES:
        if peer in found:
            yield Row(
                job=f"search {ours}, {genetic.BUDGET} evaluations",
                ours_s=found[ours].seconds,
                peer=peer,
                peer_s=found[peer].seconds,
                bar=bar,
            )
    if genetic.MISSING:
        yield genetic.SKIPPED


def _commands() -> Iterator[str]:
    """Whole commands as multiples of the start of Python, the fewer the better; long ones run by themselves."""
    for cost in commands.rows(commands.QUICK):
        yield f"  {cost}"


def _accuracy() -> Iterator[str]:
    """Errors of ours and of the best peer: a model of the true structure, and a black box tuned as the peers are."""
    for job in accuracy.jobs():
        found = dict(accuracy.rows(job))
        mine = (*job.ours, accuracy.TUNED)
        others = {name: one for name, one in found.items() if name not in mine}
        best = min(others, key=lambda name: others[name].size)
        for ours in (list(job.ours)[-1], accuracy.TUNED):
            verdict = "met" if found[ours].within_bar and found[ours].size <= others[best].size else "MISSED"
            yield f"{job.name}: {ours} {found[ours]}, best of {len(others)} peers {best} {others[best]}: {verdict}"
    yield from accuracy.skipped()


def main() -> None:
    """Print the table."""
    print(f"{'job':44} {'ours [s]':>9} {'peer':>12} {'[s]':>9} {'ratio':>8} {'bar':>6}")
    for row in rows():
        print(row, flush=True)


if __name__ == "__main__":
    main()
