"""A calibrator for a microcontroller: the engine in single precision, with the rules of the catalogue.

For whoever puts the calibration into a device: a folder that Arduino, PlatformIO and CMake take as a library.

- `package`: writes the folder; `poses`: the attitudes that advice is given in, as a table of C
- ``board``: C files and examples that stand on top of the engine's (`flinders.native`)
- `component`: writes a calibration that was made elsewhere as a component of firmware; ``components``: its files
- ``cli``: the commands
"""
