"""Drop what the data do not show."""
