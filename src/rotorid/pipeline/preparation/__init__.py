"""From logs to data: flights that are fitted, on one clock, with the model's channels and their responses."""
