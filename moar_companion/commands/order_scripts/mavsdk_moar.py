"""Orders to moar-companion by MAVSDK, for one site; written by `moar-companion site actions`.

Needs Python 3.10 or later, and `pip install mavsdk==4.1.0`.

    python mavsdk_moar.py                                   the orders of this site
    python mavsdk_moar.py udpin://0.0.0.0:14550 inspection
    python mavsdk_moar.py udpin://0.0.0.0:14550 inspection splice-1
    python mavsdk_moar.py udpin://0.0.0.0:14550 hold

The order is a COMMAND_LONG to the companion's component, by the plugin mavlink_direct. Exit status:
0 accepted, 1 not accepted or no answer, 2 no order of this site.
"""

import json
import queue
import sys
import time

import mavsdk
from mavsdk.plugins import mavlink_direct

SITE, COMPONENT, ORDERS = "", 195, ()

TIMEOUT_S = 5.0
"""Longest silence of the companion. It answers IN_PROGRESS while it plans."""
REPEAT_S = 0.5
"""Period of the repeats: the companion recognises them by their confirmation, and carries the order
out once. MAVSDK's own repeats have no confirmation."""
REASON_S = 1.0
"""The text with the reason follows the answer."""
ACCEPTED, IN_PROGRESS = 0, 5
RESULTS = (
    "accepted",
    "temporarily rejected",
    "denied",
    "unsupported",
    "failed",
    "in progress",
    "cancelled",
)
"""MAV_RESULT."""


def order_of(words):
    """The order that these words name; ends the program where there is none."""
    place = " ".join(words[1:])
    orders = [order for order in ORDERS if words and order[1] == words[0]]
    named = [order for order in orders if order[2] == place] or [
        order for order in orders if place.isdigit() and order[5] == int(place)
    ]
    if not named:
        rows = [f"    {word} {place}".rstrip() for _, word, place, *_ in orders or ORDERS]
        print(f"usage: {sys.argv[0]} URL ORDER [PLACE]; orders of {SITE}:", *rows, sep="\n")
        raise SystemExit(2)
    return named[0]


def companion_of(sdk):
    """The system that has the companion; ends the program where none is received in time."""
    until_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < until_s:
        for system in sdk.get_systems():
            if COMPONENT in system.component_ids():
                return system
        time.sleep(0.05)
    raise SystemExit(f"no companion (component {COMPONENT}) was received")


def answer_of(direct, system_id, own_ids, order, received):
    """Sends an order until its final answer, MAV_RESULT; prints the companion's texts."""
    _, _, _, command, param1, param2 = order
    until_s, repeat_s, confirmation = time.monotonic() + TIMEOUT_S, 0.0, 0
    while (now_s := time.monotonic()) < until_s:
        if now_s >= repeat_s:
            fields = {
                "target_system": system_id,
                "target_component": COMPONENT,
                "command": command,
                "confirmation": min(confirmation, 255),
                "param1": param1,
                "param2": param2,
                **{f"param{number}": 0.0 for number in range(3, 8)},
            }
            direct.send_message(
                mavlink_direct.MavlinkMessage(
                    message_name="COMMAND_LONG",
                    target_system_id=system_id,
                    target_component_id=COMPONENT,
                    fields_json=json.dumps(fields),
                )
            )
            repeat_s, confirmation = now_s + REPEAT_S, confirmation + 1
        ack = next_answer(received, min(repeat_s, until_s))
        if ack is None or ack["command"] != command:
            continue
        if (ack["target_system"], ack["target_component"]) != own_ids:
            continue
        if ack["result"] != IN_PROGRESS:
            return ack["result"]
        until_s = time.monotonic() + TIMEOUT_S
    raise SystemExit("the companion has not answered")


def next_answer(received, until_s):
    """The next COMMAND_ACK of the companion until a time; prints its texts meanwhile."""
    while (left_s := until_s - time.monotonic()) > 0.0:
        try:
            message = received.get(timeout=left_s)
        except queue.Empty:
            return None
        if message.component_id != COMPONENT:
            continue
        fields = json.loads(message.fields_json)
        if message.message_name == "COMMAND_ACK":
            return fields
        print(fields["text"])
    return None


def main(arguments):
    """Sends one order; returns the exit status."""
    order = order_of(arguments[1:])
    configuration = mavsdk.Configuration.create_with_component_type(
        mavsdk.ComponentType.GROUND_STATION
    )
    own_ids = (configuration.system_id, configuration.component_id)
    mavsdk.log_subscribe(lambda *_: True)  # MAVSDK's own log is not printed
    sdk = mavsdk.Mavsdk(configuration)
    try:
        result = sdk.add_any_connection(arguments[0])
        if result != mavsdk.ConnectionResult.SUCCESS:
            raise SystemExit(f"{arguments[0]}: {result.name.lower()}")
        system = companion_of(sdk)
        direct, received = mavlink_direct.MavlinkDirect(system), queue.SimpleQueue()
        for name in ("COMMAND_ACK", "STATUSTEXT"):
            direct.subscribe_message(name, lambda message, _: received.put(message))
        answer = answer_of(direct, system.get_system_id(), own_ids, order, received)
        print(f"{order[0]}: {RESULTS[answer] if answer < len(RESULTS) else answer}")
        if answer != ACCEPTED:
            next_answer(received, time.monotonic() + REASON_S)
        return int(answer != ACCEPTED)
    finally:
        sdk.destroy()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
