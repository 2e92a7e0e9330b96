"""How long to search, and how: all numbers that steer a planning, as records that are passed down.

They are of the request: another number may give another plan. Physical limits are not among them.
"""
