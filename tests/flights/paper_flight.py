"""The paper's flight (Section V-C, Fig. 9) in lockstep with the fake autopilot, as JSON.

    python -m tests.flights.paper_flight SITE VEHICLE

`moar-companion evaluate flight` runs it. From take-off to the first target, with no margin for
errors of position and tracking: places (x, z) of the true aircraft in the site's plane and their
times, from the start of the companion's flight until the target is reached.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace

from moar_companion.planner.site import Site
from moar_companion.settings.config import Supervision
from moar_companion.settings.vehicle import Vehicle

from .judging import in_plane
from .lockstep import Lockstep
from .operator import INSPECTION, Manner

LONGEST_S = 300.0


def fly(site: Site, vehicle: Vehicle, manner: Manner) -> dict[str, list]:
    """Flies the inspection of the first target."""
    flight = Lockstep(
        site=site,
        vehicle=replace(vehicle, guidance=replace(vehicle.guidance, tracking_margin_m=0.0)),
        manner=manner,
        supervision=Supervision(position_uncertainty_m=0.0),
    )
    flight.take_off(site.start_m[1] + 0.5 * site.workspace.resolution_m)
    flight.begin(INSPECTION, 0)
    began = len(flight.truths)
    flight.run_until_state("at_target", LONGEST_S)
    places = [
        in_plane(site, truth.latitude_deg, truth.longitude_deg, truth.altitude_amsl_m)
        for truth in flight.truths[began:]
    ]
    return {
        "time_s": [time_s - flight.states[began][0] for time_s, _ in flight.states[began:]],
        "places_m": [(x, z) for x, _, z in places],
    }


if __name__ == "__main__":
    site_file, vehicle_file = sys.argv[1:]
    flown = {
        manner.value: fly(Site.load(site_file), Vehicle.load(vehicle_file), manner)
        for manner in Manner
    }
    json.dump(flown, sys.stdout)
