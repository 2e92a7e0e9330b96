"""What a plan measures, from where and how sure: a row per setting and entity, as values, as CSV and as a table.

There is one such list: `InspectionPlan.rows`, the file beside a report and the report's own tables are made of it.
"""
