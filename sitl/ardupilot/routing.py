"""ArduPilot's routing between links, after its MAVLink_routing, as measured on ArduCopter 4.6.3.

It learns on which link a system and component was heard. A heartbeat goes to all other links, a
message without a target to all on which anyone was heard, an addressed one to where the addressee
was heard; what nobody was heard for, the autopilot takes for itself if it carries its system.
"""

from typing import Any, Final

from sitl.commands import source as sender
from sitl.links import AUTOPILOT_COMPONENT, SYSTEM, Link, Router

_NEVER_FORWARDED: Final = frozenset({"RADIO_STATUS", "RADIO"})


def route(router: Router, link: Link, message: Any) -> bool:
    """Pass a message on to where it belongs; True when the autopilot takes it, too."""
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
            return bool(other.heard)
        if component and ours:
            return (system, component) in other.heard
        return system in other.heard_systems

    forwarded = router.forward(link, message, wanted)
    return ours and (component in (0, AUTOPILOT_COMPONENT) or not forwarded)
