"""The engine for microcontrollers: a package for Arduino, PlatformIO and CMake, with the rules of the catalogue."""
