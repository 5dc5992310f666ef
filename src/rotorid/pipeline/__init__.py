"""Steps in order: from records to results."""
