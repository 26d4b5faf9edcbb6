"""The page that needs no program: static files, and the data that its JavaScript shares with this library."""
