"""Betaflight, Cleanflight and INAV: blackbox logs."""
