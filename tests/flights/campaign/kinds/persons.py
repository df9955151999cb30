"""Actions of a pilot and an operator: modes, sticks, orders, links that they lose."""

from __future__ import annotations

from ...operator import EVACUATION, EXIT, INSPECTION, RELEASE, Manner
from .. import packets
from .table import kind, set_parameters

# Pilot and operator -----------------------------------------------------------------------------


@kind("no ground station is heard", lasts_s=(3.0, 30.0))
def gcs_lost(flight, rng):
    operator = flight.operator
    operator.silent = True
    return lambda: setattr(operator, "silent", False)


@kind("the remote control is lost", lasts_s=(1.0, 15.0))
def rc_lost(flight, rng):
    if flight.operator.manner is Manner.ARDUPILOT:
        return set_parameters(flight, SIM_RC_FAIL=1)
    flight.autopilot.move_sticks()
    flight.later(1.0, flight.autopilot.no_sticks)
    return flight.autopilot.move_sticks


@kind("the pilot takes the mode: hold or position")
def pilot_takes_mode(flight, rng):
    mode = rng.choice(("hold", "position"))
    flight.note(mode=mode)
    flight.autopilot.move_sticks()
    flight.later(0.2, lambda: flight.operator.mode(mode))


@kind("the pilot takes the mode and gives it back", lasts_s=(0.1, 6.0))
def pilot_gives_back(flight, rng):
    mode = rng.choice(("hold", "position"))
    flight.note(mode=mode)
    flight.autopilot.move_sticks()
    flight.operator.mode(mode)
    return lambda: flight.operator.mode("ours")


@kind("the pilot takes position mode and flies by the sticks", lasts_s=(1.0, 6.0))
def pilot_flies(flight, rng):
    roll, pitch = rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6)
    flight.note(roll=roll, pitch=pitch)
    flight.autopilot.move_sticks()
    flight.later(0.2, lambda: flight.operator.mode("position"))
    flight.later(0.4, lambda: flight.autopilot.move_sticks(roll=roll, pitch=pitch))
    return flight.autopilot.move_sticks


@kind(
    "the pilot moves the sticks, and the autopilot takes that as his",
    lasts_s=(0.5, 3.0),
    manners=frozenset({Manner.PX4}),
)
def sticks_take(flight, rng):
    flight.autopilot.set_parameter("COM_RC_OVERRIDE", 3)
    flight.autopilot.move_sticks()
    flight.later(0.5, lambda: flight.autopilot.move_sticks(roll=rng.uniform(0.5, 1.0)))
    return flight.autopilot.move_sticks


@kind("the operator lands or returns by the autopilot's own mode")
def operator_lands(flight, rng):
    mode = rng.choice(("land", "return"))
    flight.note(mode=mode)
    flight.operator.mode(mode)


@kind("orders that contradict each other, every 0.1 to 0.6 s", lasts_s=(2.0, 6.0))
def orders_contradict(flight, rng):
    due = [0.0]

    def order(_):
        if flight.now_s >= due[0]:
            due[0] = flight.now_s + rng.uniform(0.1, 0.6)
            flight.order(rng.choice((INSPECTION, EXIT, EVACUATION)))

    return flight.each_step(order)


@kind("the operator releases, and orders anew", lasts_s=(1.0, 8.0))
def released(flight, rng):
    flight.order(RELEASE)
    return lambda: flight.order(INSPECTION)


# Releases that the operator answers with `continue`: each act of the fault ends, then he orders.


@kind("the loop stands still until it releases; the operator orders `continue`", lasts_s=(0.6, 3.0))
def stall_then_continue(flight, rng):
    flight.stop_companion(killed=False)
    return _then_continue(flight, rng, flight.wake_companion)


@kind("no position until it releases; the operator orders `continue`", lasts_s=(1.0, 6.0))
def silence_then_continue(flight, rng):
    silent = packets.drop(packets.LOCAL_POSITION, packets.ODOMETRY)
    return _then_continue(flight, rng, flight.filter(silent))


@kind("the pilot takes the mode; the operator orders `continue`", lasts_s=(1.0, 6.0))
def takeover_then_continue(flight, rng):
    mode = rng.choice(("hold", "position"))
    flight.note(mode=mode)
    flight.autopilot.move_sticks()
    flight.operator.mode(mode)
    return _then_continue(flight, rng, lambda: None)


def _then_continue(flight, rng, undo):
    """The function that ends the fault; some seconds later the operator orders `continue`."""
    after_s = rng.uniform(0.5, 12.0)
    flight.note(continued_after_s=after_s)

    def end():
        undo()
        flight.later(after_s, lambda: flight.pause_or_go_on("go_on"))

    return end
