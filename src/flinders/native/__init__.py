"""The engine: fits and statistics of recordings in one small C library, and the module that calls it."""
