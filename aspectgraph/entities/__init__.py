"""What can be measured: named straight edges, rims and arcs of a solid.

Every entity is an edge, or a chain of collinear edges, that is sharp and belongs to no curve; or all chords of a sharp
circular edge, closed (a rim) or open (an arc), with the circle they stand for. None is named twice.
"""
