"""Self-contained pages: about a log, about measured responses, about identifications."""
