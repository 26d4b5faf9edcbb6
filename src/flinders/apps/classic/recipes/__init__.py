"""Published methods, each after its paper or program, as references for `auto`."""
