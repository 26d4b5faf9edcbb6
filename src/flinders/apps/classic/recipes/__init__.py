"""Published methods, each after its paper or program: what `auto` is measured against."""
