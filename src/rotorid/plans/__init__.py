"""Files that fly a plan: for ArduPilot, PX4 and Betaflight."""
