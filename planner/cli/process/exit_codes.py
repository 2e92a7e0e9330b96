"""Exit codes of the command line."""

DONE = 0
INCOMPLETE = 1
BAD_INPUT = 2
# an image does not show the part as the plan has it
NOT_REGISTERED = 3

# a fault of the program: EX_SOFTWARE of sysexits.h, so that no script takes it for a result
INTERNAL = 70

# 128 + SIGPIPE, as a shell tells of any program that writes to a pipe whose reader has ended
NOBODY_READS = 141
