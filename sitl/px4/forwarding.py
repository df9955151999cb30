"""PX4's forwarding between links, as measured on PX4 v1.17.0.

Only between links that both forward, and only to a link on which a sender was received. Addressed
messages only to a link on which the addressee was received.
"""

from collections.abc import Callable
from typing import Any

from sitl.links import AUTOPILOT_COMPONENT, SYSTEM, Link, Router


def forward(router: Router, source: Link, message: Any, forwards: Callable[[Link], bool]) -> None:
    """Pass a message on to the other links that should have it."""
    if not forwards(source):
        return
    system = getattr(message, "target_system", 0)
    component = getattr(message, "target_component", 0)
    if (system, component) == (SYSTEM, AUTOPILOT_COMPONENT):
        return

    def wanted(link: Link) -> bool:
        if not link.senders or not forwards(link):
            return False
        if not system:
            return True
        if component:
            return (system, component) in link.senders
        return system in link.sender_systems

    router.forward(source, message, wanted)
