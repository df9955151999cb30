"""The manner of PX4 v1.17, as measured on PX4 v1.17.0 with its built-in simulation."""

from sitl.px4.vehicle import Px4Manner

__all__ = ["Px4Manner"]
