"""Statistics of readings that add: those of the parts of a recording merge to those of the whole."""
