"""Use cases. Each is one function of recordings and calibrations, which a command of the program calls.

The functions print nothing. Their results are values: numbers, and `Note`s whose sentences each interface makes.
"""
