"""One self-contained page about finished identifications."""
