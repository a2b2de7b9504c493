"""How a command line becomes one call: the application, types of options, and what a command returns."""
