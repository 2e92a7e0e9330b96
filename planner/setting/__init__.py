"""One sensor setting for one set of entities, searched for.

A setting found satisfies every constraint of its request; where none is found, the error names constraint, entity and
amount. The same request with the same seed gives the same setting.
"""

from planner.setting.plan_setting import plan_setting
from planner.setting.pose_search import Search
from planner.setting.sensor_setting import SensorSetting
from planner.setting.viewpoint_sampling import ViewpointSampler

__all__ = [
    "Search",
    "SensorSetting",
    "ViewpointSampler",
    "plan_setting",
]
