"""The engine: a small C library for fits and statistics of recordings, and the modules that call it."""
