"""Controllers of autopilots as their parameters describe them: which names, which units, which order of blocks."""
