"""The head of a report: where the plan comes from, and the part with all targets called out."""
