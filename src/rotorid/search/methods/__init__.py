"""One search in each file, under its name; a new file is a new search."""
