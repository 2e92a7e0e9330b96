"""Exit codes of the command line."""

DONE, INCOMPLETE, BAD_INPUT = 0, 1, 2

# 128 + SIGPIPE, as a shell tells of any program that writes to a pipe whose reader has ended
NOBODY_READS = 141
