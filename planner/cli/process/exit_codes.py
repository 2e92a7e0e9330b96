"""Exit codes of the command line."""

DONE = 0
INCOMPLETE = 1
BAD_INPUT = 2

# 128 + SIGPIPE, as a shell tells of any program that writes to a pipe whose reader has ended
NOBODY_READS = 141
