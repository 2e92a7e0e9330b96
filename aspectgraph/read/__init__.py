"""Part files in, a `Solid` in millimetres out.

Every repair is noted in the solid, nothing is guessed: what cannot be read as a closed surface is refused.
"""
