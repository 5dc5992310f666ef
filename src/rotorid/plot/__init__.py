"""Pictures: arrays in, figure out, nothing computed but units."""
