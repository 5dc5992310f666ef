"""Models fitted to frequency responses."""
