"""Calibrator for a microcontroller: the engine in single precision, which fits, and judges the fit by the same rules.

For developers of devices: the output is a library for Arduino, PlatformIO and CMake.

- `package`: writes the folder; `poses`: names of attitudes for advice, as a table in C
- ``board``: C files and examples, in addition to the engine's (`flinders.native`)
- `component`: writes a calibration as a component of firmware; ``components``: its files
- ``cli``: the commands
"""
