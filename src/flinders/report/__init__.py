"""Renderings of the same `Fit`; they compute nothing."""
