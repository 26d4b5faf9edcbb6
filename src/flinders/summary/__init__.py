"""Statistics of readings that add: halves of a recording, or a million of them, merge to those of the whole."""
