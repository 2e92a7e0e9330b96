"""The entity-based aspect graph: viewing domains as nodes, common boundaries as edges, and its files.

Every domain's list was confirmed by rays, and doubts were settled exactly. A graph written to GraphML and read again is
the same.
"""
