"""What is asked: targets and dimensions, constraints as signed margins, the probability to maximise.

What a dimension asks for is checked before anything is planned, and an error names it. A margin of
0 or more is a constraint met. Nothing here searches.

Names are imported from their modules, so that a light one does not wait for the compiler.
"""
