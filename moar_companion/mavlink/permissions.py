"""Permission to command, by the section `commands` of the configuration. Pure.

A sender chooses the ids of its MAVLink packets: ids separate cooperating systems only. Only a
signature proves the sender's identity.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..settings.config import GROUND_STATION_IDS, Commands
from ..settings.mqtt_config import ORDER_LINK
from ..texts import pilot_texts
from .commands import Sender


@dataclass(frozen=True, slots=True)
class Permissions:
    """Rules of the configuration, for the companion of one vehicle."""

    rules: Commands

    def allows_system(self, system_id: int, *, vehicle_id: int) -> bool:
        """Returns True if a system may command. vehicle_id: of the autopilot and the companion."""
        if self.rules.systems is None:
            return system_id in GROUND_STATION_IDS or system_id == vehicle_id
        return system_id in self.rules.systems

    def objection(self, sender: Sender, *, vehicle_id: int, signed: bool) -> str | None:
        """Reason why a sender may not command, as a text; None if permitted.

        signed: True if the command's packet has a correct signature.
        """
        rules = self.rules
        if sender.link == ORDER_LINK:
            return None  # each of its orders is signed with a key of its own
        if rules.links is not None and sender.link not in rules.links:
            return pilot_texts.LINK_MAY_NOT(detail=f"{sender.link}; commands.links")
        if not self.allows_system(sender.system_id, vehicle_id=vehicle_id):
            return pilot_texts.SYSTEM_MAY_NOT(id=sender.system_id, detail="commands.systems")
        if rules.components is not None and sender.component_id not in rules.components:
            return pilot_texts.COMPONENT_MAY_NOT(
                id=sender.component_id, detail="commands.components"
            )
        if rules.signed_only and not signed:
            return pilot_texts.UNSIGNED(detail="commands.signed_only")
        return None
