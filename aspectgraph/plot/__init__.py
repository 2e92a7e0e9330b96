"""Pictures of parts, domains and graphs.

They are drawn in doubles and decide nothing. matplotlib and plotly are imported when a picture is asked for.
"""
