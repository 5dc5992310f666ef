"""Fits in time: linear forms and nonlinear structures, from records to bounds, and what is remarked on them."""
