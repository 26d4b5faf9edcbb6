"""Tests of a recording for faults: sensors at rest, drift, exchanged axes, instruments that disagree."""
