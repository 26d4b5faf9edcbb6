"""Packages for one trade each, with all that it needs: readers, targets, formulas, pages, commands.

A package here imports the library and none of its neighbours. The library imports none of them: it finds their rows
(``rows.py`` of each) by `flinders.core.plugins`, and works as well where a package is not there.
"""
