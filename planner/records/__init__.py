"""Plan and state files, read strictly: what the schema forbids, or what contradicts itself, is refused by its path."""

from planner.records.json_file import encoded, number, read_json
from planner.records.packing import packed, unpacked
from planner.records.plan_check import check_plan, check_state
from planner.records.schema import check_schema, shown

__all__ = [
    "check_plan",
    "check_schema",
    "check_state",
    "encoded",
    "number",
    "packed",
    "read_json",
    "shown",
    "unpacked",
]
