"""Exit codes of the command line."""

DONE, INCOMPLETE, BAD_INPUT = 0, 1, 2
