"""Renderings of a `Fit`; they compute no results."""
