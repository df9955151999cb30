"""ArduPilot's routing between links, after its MAVLink_routing, as measured on ArduCopter 4.6.3.

It stores the link on which each system and component was received. A heartbeat is sent to all other
links. A message without a target is sent to all links on which a sender was received, an addressed
one to the links of its addressee. The autopilot takes a message with its system that no link takes.
"""

from typing import Any, Final

from sitl.commands import source as sender
from sitl.links import AUTOPILOT_COMPONENT, SYSTEM, Link, Router

_NEVER_FORWARDED: Final = frozenset({"RADIO_STATUS", "RADIO"})


def route(router: Router, link: Link, message: Any) -> bool:
    """Pass a message on to its links; True when the autopilot takes it, too."""
    if sender(message) == (SYSTEM, AUTOPILOT_COMPONENT):
        return False
    kind = message.get_type()
    if kind in _NEVER_FORWARDED:
        return True
    if kind == "HEARTBEAT":
        router.forward(link, message, lambda _: True)
        return True
    system = getattr(message, "target_system", 0)
    component = getattr(message, "target_component", 0)
    ours = system in (0, SYSTEM)
    if system == SYSTEM and component == AUTOPILOT_COMPONENT:
        return True

    def wanted(other: Link) -> bool:
        if not system:
            return bool(other.senders)
        if component and ours:
            return (system, component) in other.senders
        return system in other.sender_systems

    forwarded = router.forward(link, message, wanted)
    return ours and (component in (0, AUTOPILOT_COMPONENT) or not forwarded)
