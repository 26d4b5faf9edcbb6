"""Use cases: each is one function over recordings and calibrations, and a command of the program calls it.

They print nothing, and results are values: what was found as numbers, and `Note`s whose words are made where they are
shown.
"""
