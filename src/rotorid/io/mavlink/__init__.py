"""Telemetry logs of MAVLink."""
