"""Commands of this package: parse, one call, print."""
