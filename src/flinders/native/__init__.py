"""The engine: a C library for fits and statistics of recordings, and the Python modules that call it."""
