"""Conventions: other tools' parameters and the formula by which they use them, one file each.

Each turns a calibration into the parameters of its tool and back, and runs the tool's own formula on readings, so that
what is written for a tool can be checked as the tool will use it. They know calibrations and what is below them.
"""
