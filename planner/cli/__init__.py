"""The command line: options, the commands, and exit codes.

Errors are one line on standard error, never a traceback. Commands are imported when they are run, so that
``--help`` is immediate.
"""
