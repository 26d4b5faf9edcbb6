"""Rows that this package adds to the tables of the library, with names of its modules, imported at first use."""

CLASSIC = "Classic recipes"

PUBLIC = {"compare_methods": "methods"}
COMMANDS = {
    "two-axis": (CLASSIC, "cli.two_axis", "Hard and soft iron of one plane, by the two-axis recipe."),
    "budget": (CLASSIC, "cli.budget", "Find the distance that a cable must have."),
    "compare-methods": (CLASSIC, "cli.compare_methods", "Run all methods on a recording, side by side."),
}
SIMULATIONS = {"two-axis": ("Commands", "cli.simulate", "A two-axis compass, swung around.")}
METHODS = {
    "alonso_shuster": "recipes.alonso_shuster",
    "axes": "recipes.axes",
    "ekf": "recipes.ekf",
    "ellipsoid": "recipes.ellipsoid",
    "li": "recipes.li",
    "sequential": "recipes.sequential",
    "sphere": "recipes.sphere",
    "two_axis": "two_axis_recipe",
    "two_step": "recipes.two_step",
}
TARGETS = {"adis16480": "adis16480"}
REMARKS = {"two columns": "two, of a level turn, are for flinders two-axis"}
