"""Crazyflie: what is known of it."""

from __future__ import annotations

from rotorid.autopilots.autopilot import Advice, Autopilot, Log, sweep_by_stick

CRAZYFLIE = Autopilot(
    name="Crazyflie",
    key="crazyflie",
    log=Log(own=True, outputs_scaled=True),
    advice=Advice(flying=sweep_by_stick),
    vehicle="crazyflie",
)
