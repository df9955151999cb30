"""The kinds of faults, as one table: a seed draws from it in the order of these modules."""

from . import air, links, persons, systems
from .table import KINDS, Breaks

__all__ = ["KINDS", "Breaks", "air", "links", "persons", "systems"]
