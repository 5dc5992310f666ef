"""Global search: many starts, populations, patterns; every one ends in a local search and keeps all minima."""
