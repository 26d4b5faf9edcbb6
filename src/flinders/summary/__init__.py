"""Statistics of readings; the statistics of the parts of a recording add up to those of the whole."""
