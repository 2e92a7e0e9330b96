"""STEP files, read with a large C++ library in a process of its own.

Whatever a file does to that process, the caller gets a solid or an error, within the limits of time and memory.
"""
