"""Known truths: published vehicles with their numbers and sources, and the flight that ships with rotorid."""

from rotorid.vehicles import s500
from rotorid.vehicles.demo import demo_plan

__all__ = ["demo_plan", "s500"]
