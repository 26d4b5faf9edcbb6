"""The page that needs no program: a folder of static files, and the data that its JavaScript shares with Python."""
