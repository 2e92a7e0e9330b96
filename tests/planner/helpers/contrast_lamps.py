"""Lamps for a plan by contrast alone, whether or not `measure` would find enough of each target."""

from planner.light.lighting import Lighting
from planner.light.plan_light import chosen_lamps


def contrast_lamps(plan, solid, lamps, progress=None, **options):
    lighting = lamps if isinstance(lamps, Lighting) else Lighting(lamps, **options)
    return chosen_lamps(lighting, plan, solid, progress)
