"""Columns in which the kernel of a flight logs."""

from __future__ import annotations

RATE_RAW, ACCELERATION_RAW, RATE, ACCELERATION = 0, 3, 6, 9
ANGLE, VELOCITY, POSITION, ANGLE_SETPOINT, RATE_SETPOINT = 12, 15, 18, 21, 24
COMMAND, VOLTAGE, SATURATED, MOTORS = 27, 31, 32, 33
"""First column of each group; the motors come last."""
