"""The live page as a folder of static files, which needs no program: `package` writes it, the rest is its data."""
