"""Semantic dimensions of a STEP file (AP242): what the file states, and where each instance of a part has it.

This room imports nothing by itself: the kernel's process loads its modules only when it is asked for dimensions.
"""
