"""Renderings of a `Fit` as text, pages, figures and files; no results are computed here."""
