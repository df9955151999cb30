"""The SIM_ parameters, by which a ground station changes the world in flight."""

from typing import Final

from sitl.conditions import Conditions
from sitl.parameters import INT32, Parameter, Parameters

TABLE: Final = (
    Parameter(name="SIM_BATT_DRAIN", default=1.0, minimum=0.0, maximum=1000.0),
    Parameter(name="SIM_BATT_PCT", default=100.0, minimum=0.0, maximum=100.0),
    Parameter(name="SIM_DRAG", default=-1.0, minimum=-1.0, maximum=10.0),
    Parameter(name="SIM_GPS_HDOP", default=0.7, minimum=0.3, maximum=99.0),
    Parameter(name="SIM_GPS_MODE", default=0, type=INT32, minimum=0, maximum=3),
    Parameter(name="SIM_GPS_NOISE", default=1.0, minimum=0.0, maximum=100.0),
    Parameter(name="SIM_GPS_SATS", default=10, type=INT32, minimum=0, maximum=60),
    Parameter(name="SIM_LINK_LOSS", default=0.0, minimum=0.0, maximum=100.0),
    Parameter(name="SIM_LINK_NOISE", default=45.0, minimum=0.0, maximum=254.0),
    Parameter(name="SIM_LINK_RSSI", default=-1.0, minimum=-1.0, maximum=254.0),
    Parameter(name="SIM_WIND_DIR", default=0.0, minimum=-360.0, maximum=360.0),
    Parameter(name="SIM_WIND_GUST", default=0.0, minimum=0.0, maximum=20.0),
    Parameter(name="SIM_WIND_SPD", default=0.0, minimum=0.0, maximum=60.0),
)
"""SIM_WIND_DIR: direction the wind comes from, degrees; SIM_LINK_RSSI -1: no radio; SIM_DRAG -1:
the airframe's own drag."""
_FIELDS: Final = {
    "SIM_BATT_DRAIN": "drain_factor",
    "SIM_BATT_PCT": "battery_percent",
    "SIM_DRAG": "drag_per_s",
    "SIM_GPS_HDOP": "hdop",
    "SIM_GPS_MODE": "gps_mode",
    "SIM_GPS_NOISE": "gps_noise_factor",
    "SIM_GPS_SATS": "satellites",
    "SIM_LINK_LOSS": "link_loss_percent",
    "SIM_LINK_NOISE": "radio_noise",
    "SIM_LINK_RSSI": "radio_rssi",
    "SIM_WIND_DIR": "wind_from_deg",
    "SIM_WIND_GUST": "gust_mps",
    "SIM_WIND_SPD": "wind_mps",
}


def apply(name: str, parameters: Parameters, conditions: Conditions) -> None:
    """Apply a parameter that was set to the world, if it is one of these."""
    field = _FIELDS.get(name)
    if field is None:
        return
    value: float | None = parameters.value(name)
    if name in {"SIM_LINK_RSSI", "SIM_DRAG"} and value is not None and value < 0.0:
        value = None
    setattr(conditions, field, value)
