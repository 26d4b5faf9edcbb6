"""Use cases: each is one function of recordings and calibrations, which a command of the program calls.

They print nothing. Results are values: numbers, and `Note`s whose sentences are made by the interface.
"""
