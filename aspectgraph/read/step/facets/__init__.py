"""Triangles of STEP files: those the kernel's mesher makes, and those the file itself states.

Import its modules in full: one of them imports OCP.
"""

__all__: list[str] = []
