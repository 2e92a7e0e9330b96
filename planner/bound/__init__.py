"""A proven lower bound on the number of settings.

No plan for the same request can have fewer. The proof rests on conditions that every setting must meet; what it
allows for rounding and for how finely a robot can aim are constants beside the loops. Searching longer may raise the
bound, stopping early only leaves it lower.
"""
