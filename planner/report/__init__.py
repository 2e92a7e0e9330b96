"""What a report tells beyond the plan itself: rows of values and what they warn of, what binds, views, the graph.

It computes and formats; the page around it is `planner.output.report`.
"""
