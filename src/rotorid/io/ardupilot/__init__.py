"""ArduPilot: DataFlash files, and how simulated flights are written as one."""
