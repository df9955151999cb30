"""The flight after an offboard loss, by some parameters of an autopilot, else by its defaults."""

from moar_companion.autopilots import profile


def loss_of(kind, **parameters):
    known = profile(kind)
    return known.offboard_loss(known.with_silence(parameters))
