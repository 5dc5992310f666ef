"""Predictions of flights that were not fitted."""
