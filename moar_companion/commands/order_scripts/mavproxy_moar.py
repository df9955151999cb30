"""Orders to moar-companion from MAVProxy, for one site; written by `moar-companion site actions`.

With this file's folder on PYTHONPATH:

    module load mavproxy_moar
    moar                            the orders of this site
    moar inspection                 every target in turn
    moar inspection splice-1        one target, by its name or its index
    moar hold
    moar takeover                   the autopilot's own hold: PX4 HOLD, ArduPilot BRAKE

The orders go to the companion's component alone; MAVProxy's own commands go to the autopilot as
before. Never `set target_component` to the companion's: `mode` then goes to the companion, which
denies it and flies on. `mode` of MAVProxy 1.8.75 fails with PX4: take over by `moar takeover`, or
by the sticks' mode switch.
"""

import time

from MAVProxy.modules.lib import mp_module
from pymavlink import mavutil

SITE, COMPONENT, ORDERS = "", 195, ()

REPEAT_S = 1.0
"""Period of the repeats, as MAVLink's command protocol requires: the companion recognises them by
their confirmation, and carries the order out once."""
TIMEOUT_S = 5.0
"""Longest silence of the companion. It answers IN_PROGRESS while it plans."""
CHUNK_CHARS = 50
"""Characters of a STATUSTEXT; a text of which another part follows has as many."""
AUTOPILOT = mavutil.mavlink.MAV_COMP_ID_AUTOPILOT1
CUSTOM_MODE = mavutil.mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
TAKEOVERS = {
    mavutil.mavlink.MAV_AUTOPILOT_PX4: ("HOLD", (CUSTOM_MODE, 4.0, 3.0)),
    mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: ("BRAKE", (CUSTOM_MODE, 17.0, 0.0)),
}
"""Mode in which the autopilot stops and needs no sticks: its name, parameters of DO_SET_MODE."""


class MoarModule(mp_module.MPModule):
    """The command `moar`: sends an order until it is answered."""

    def __init__(self, mpstate):
        super().__init__(mpstate, "mavproxy_moar", "orders to moar-companion")
        self.autopilot = None
        self.waiting = None
        """The command without an answer: its label, component, MAV_CMD and parameters."""
        self.sent = 0
        self.sent_s = self.until_s = 0.0
        self.chunks = {}
        self.warned = False
        words = "|".join(dict.fromkeys([*(order[1] for order in ORDERS), "takeover"]))
        self.add_command("moar", self.cmd_moar, "order moar-companion", [f"<{words}> (MOARPLACE)"])
        self.add_completion_function("(MOARPLACE)", self.places)

    def unload(self):
        """Removes the command."""
        self.remove_command("moar")

    def places(self, _text):
        """Names of places, for the Tab key: those that are one word to MAVProxy."""
        return [order[2] for order in ORDERS if order[2] and not set(order[2]) & set(" \t;\"'")]

    def cmd_moar(self, args):
        """Sends an order; lists them where the words name none."""
        if args == ["takeover"]:
            self.take_over()
            return
        place = " ".join(args[1:])
        orders = [order for order in ORDERS if args and order[1] == args[0]]
        named = [order for order in orders if order[2] == place] or [
            order for order in orders if place.isdigit() and order[5] == int(place)
        ]
        if named:
            label, _, _, command, *params = named[0]
            self.order(label, COMPONENT, command, params)
            return
        print(f"moar: orders of {SITE}:")
        for _, word, place, _, _, index in orders or ORDERS:
            number = f" (or {index:.0f})" if index >= 0.0 and place != f"{index:.0f}" else ""
            print(f"    moar {word} {place}{number}")
        print("    moar takeover")

    def take_over(self):
        """Selects the autopilot's own hold, whatever target_component is."""
        if self.autopilot not in TAKEOVERS:
            print("moar: the autopilot is not received")
            return
        mode, params = TAKEOVERS[self.autopilot]
        self.order(mode, AUTOPILOT, mavutil.mavlink.MAV_CMD_DO_SET_MODE, params)

    def order(self, label, component, command, params):
        """Sends a command, and awaits its answer; it replaces one that is still awaited."""
        self.waiting, self.sent = (label, component, command, params), 0
        self.until_s = time.time() + TIMEOUT_S
        self.send()

    def send(self):
        """Sends the command that waits for its answer."""
        _, component, command, params = self.waiting
        padded = [*params, *[0.0] * (7 - len(params))]
        self.master.mav.command_long_send(
            self.target_system, component, command, min(self.sent, 255), *padded
        )
        self.sent += 1
        self.sent_s = time.time()

    def idle_task(self):
        """Repeats the command, or reports the silence; warns of a wrong target_component."""
        now_s, wrong = time.time(), self.settings.target_component == COMPONENT
        if wrong and not self.warned:
            print(
                f"moar: target_component is {COMPONENT}, the companion: `mode` does not reach the "
                f"autopilot. Set it back: set target_component {AUTOPILOT}"
            )
        self.warned = wrong
        if self.waiting is None:
            return
        if now_s > self.until_s:
            print(f"moar: no answer to {self.waiting[0]}")
            self.waiting = None
        elif now_s - self.sent_s > REPEAT_S:
            self.send()

    def mavlink_packet(self, m):
        """Shows answers, and the companion's texts."""
        if m.get_srcSystem() != self.target_system:
            return
        kind = m.get_type()
        if kind == "HEARTBEAT" and m.autopilot in TAKEOVERS:
            self.autopilot = m.autopilot
        elif kind == "COMMAND_ACK":
            self.take_answer(m)
        elif (
            kind == "STATUSTEXT"
            and m.get_srcComponent() == COMPONENT
            and not self.message_is_from_primary_vehicle(m)
        ):
            self.add_text(m)  # MAVProxy shows those of the autopilot alone

    def take_answer(self, ack):
        """Ends the wait for the answer, or prolongs it while the companion plans."""
        if self.waiting is None or (ack.get_srcComponent(), ack.command) != self.waiting[1:3]:
            return
        receiver = getattr(ack, "target_system", 0)  # MAVLink 1 has none
        if receiver not in (0, self.settings.source_system):
            return
        if ack.result == mavutil.mavlink.MAV_RESULT_IN_PROGRESS:
            self.until_s = time.time() + TIMEOUT_S
            return
        result = mavutil.mavlink.enums["MAV_RESULT"].get(ack.result)
        words = result.name[len("MAV_RESULT_") :] if result else f"result {ack.result}"
        print(f"moar: {self.waiting[0]}: {words}")
        self.waiting = None

    def add_text(self, part):
        """Prints a text when its last part has arrived."""
        parts = self.chunks.setdefault(part.id, {}) if part.id else {}
        parts[part.chunk_seq] = part.text
        if part.id and len(part.text) == CHUNK_CHARS:
            return
        self.chunks.pop(part.id, None)
        text = "".join(parts[number] for number in sorted(parts))
        print(" ".join(text.split()))  # parts are filled with blanks


def init(mpstate):
    """Makes the module, as MAVProxy loads it."""
    return MoarModule(mpstate)
