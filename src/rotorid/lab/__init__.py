"""Identification in the browser: a page on this machine that runs the commands of the command line."""
