"""The page without a server: static files, and the data that its JavaScript shares with this library."""
