"""The kinds of faults, as one table: a seed draws from it in the order of these modules."""

from . import air, firmware, links, near, persons, secured, sensors, systems
from .table import KINDS, Breaks

__all__ = [
    "KINDS", "Breaks", "air", "firmware", "links", "near", "persons", "secured", "sensors",
    "systems",
]  # fmt: skip
