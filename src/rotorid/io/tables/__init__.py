"""Tables and arrays of any source, whose channels a mapping names."""
