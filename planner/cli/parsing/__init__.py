"""How the command line is read: numbers with units, options and commands with a wrong name, help."""
