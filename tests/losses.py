"""The flight after an offboard loss, by some parameters of an autopilot, else by its defaults."""

from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.parameter_names import Parameters


def loss_of(kind, **parameters):
    known = profile(kind)
    return known.offboard_loss(Parameters({**known.parameters.defaults, **parameters}))
