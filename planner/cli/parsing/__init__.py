"""Reading of the command line: numbers with units, wrong names of options, help."""
