"""What a recording shows of its own faults: still sensors, drift, exchanged axes, instruments that disagree."""
