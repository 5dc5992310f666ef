"""A model on flights that it has not seen."""
