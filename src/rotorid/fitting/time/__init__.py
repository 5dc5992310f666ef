"""Models fitted to time histories: output error, prediction error, nonlinear equations."""
