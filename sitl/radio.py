"""A telemetry radio on each link: RADIO_STATUS once a second, from its own ids."""

from typing import Final

from sitl.links import Router
from sitl.wire import layout
from sitl.world import World

_PERIOD_US: Final = 1_000_000


class Radio:
    """Sends while the conditions have a signal strength; an IP link has no radio."""

    def __init__(self, world: World, router: Router) -> None:
        """Send first after a second."""
        self._world = world
        self._router = router
        self._next_us = world.now_us + _PERIOD_US

    def step(self) -> None:
        """Send RADIO_STATUS if it is due."""
        if self._world.now_us < self._next_us:
            return
        self._next_us += _PERIOD_US
        conditions = self._world.conditions
        if conditions.radio_rssi is None:
            return
        remote = conditions.radio_remote_rssi
        kind = layout("RADIO_STATUS")
        payload = kind.payload(
            rssi=round(conditions.radio_rssi),
            remrssi=round(conditions.radio_rssi if remote is None else remote),
            txbuf=95,
            noise=round(conditions.radio_noise),
            remnoise=round(conditions.radio_noise),
            rxerrors=0,
            fixed=0,
        )
        for link in self._router.links.values():
            link.send_as_radio(kind, payload)
