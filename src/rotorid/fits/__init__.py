"""Fits of a log: in frequency, in time, of motors, with their searches and bounds."""
