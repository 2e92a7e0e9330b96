"""The process around a command: its streams, signals and exit codes, and what it lacks to go on.

Nothing here loads another part of the project. So it works where memory does not suffice for them.
"""
