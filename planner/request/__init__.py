"""What is asked of a setting: constraints as signed margins, and the probability to maximise.

A margin of 0 or more is a constraint met. Nothing here searches.

Names are imported from their modules, so that a light one does not wait for the compiler.
"""
