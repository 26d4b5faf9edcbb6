"""Commands of this package: each parses its options, calls one function and prints the result."""
