"""The report: one page, its sections, figures, predicted images and words; what it says beyond the plan itself.

`planner.report.page` puts it together. Nothing here changes a plan or judges it anew.
"""
