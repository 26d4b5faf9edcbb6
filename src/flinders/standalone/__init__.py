"""The page that needs no program: a folder of static files with the engine as WebAssembly."""
