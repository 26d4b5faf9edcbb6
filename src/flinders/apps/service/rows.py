"""What this package adds to tables of the library, by names of its modules; nothing is imported before it is used."""

WIRE = "Sensors on a wire"

COMMANDS = {"watch": (WIRE, "cli.watch", "Keep a calibration while a vehicle works.")}
SIMULATIONS = {"boat": ("Commands", "cli.simulate", "A boat for some days, to see a calibration keep itself.")}
