"""Exact signs, and the part on an integer grid in its own frame, unit and order.

No sign computed here depends on rounding. A copy of the part that was turned, moved, scaled or listed in another order
gets the same integers.
"""
