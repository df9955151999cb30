"""Refuge: the nearest place where a position error, or the autopilot by itself, hits nothing.

Inputs: the flight volume, the autopilot's failsafes, the position's uncertainty, the ruling.
Outputs: threats to the aircraft's place, for the checks; while the supervisor requires it, the leg
to the refuge, where the aircraft holds; texts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..mavlink.autopilots.failsafe_actions import BATTERY, FailsafeAction, Failsafes, Trigger
from ..mavlink.session import Severity
from ..planner.escape import refuge_leg
from ..planner.grid import FloatArray
from ..planner.maps import Maps
from ..planner.regions import obstacle_room_m
from ..planner.site import PlanePoint
from ..risk.power import PowerModel
from ..settings.config import Supervision
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..texts.text_format import distance, reason_chars, seconds, with_name
from ..types import Vector
from .contingency.route_cost import straight_s
from .guidance.flight_volume import FlightVolume
from .guidance.path_follower import PathFollower
from .mission.values import MissionStatus
from .mission_states import MissionState
from .reports import Reports
from .risk_monitor import RiskMonitor
from .safety.condition_types import Action
from .safety.failsafe_paths import failsafe_hit
from .safety.refuges import BLIND_LEG_M, spare_at_m, spare_in_cells_m
from .safety.supervisor import Ruling
from .safety.uncertainty_growth import AHEAD_S

_LASTS_S = 30.0
"""Time for which the growth of the error is assumed to go on at the refuge: a pilot has taken over
until then."""
_BLIND_M = 1.0
"""Error that dead reckoning adds until the end of the leg: 0.9 m in 5 s, as PX4 reports it."""
_OVERDUE_S = 30.0
"""Time after which an action that a first forecast announced does not come: PX4 holds 5 s before it
(COM_FAIL_ACT_T), ArduPilot waits 10 s (BATT_LOW_TIMER), and both filter. The escape route, on which
the action would hit an obstacle, goes on then."""
_OVER_S = 5.0
"""Time without the threat after which the next forecast is a first one."""
_BLIND_BEGINS_S = 8.0
"""Time after the loss of the fix in which a leg may begin: ArduPilot lands 7.9 s after it. An
autopilot that has not landed by then has another source of its position."""
_CACHED = 8
"""Number of failsafes whose cells are kept."""
_ELSEWHERE_M = 5.0
"""Distance from a place without a better one from which another search may find one."""
_AGAIN_S = 0.5
"""Time between two searches for a refuge."""
_WORTH_M = 0.5
"""Least gain for which another leg is begun: two cells."""
_BLIND = frozenset({Trigger.GPS_LOSS})


class _Threats(NamedTuple):
    """What threatens: a position error, a landing without a position, a battery's landing."""

    error: bool
    blind: bool
    battery: bool


class _Found(NamedTuple):
    """Result of a search.

    lacking: the place itself is not clear. leg_m: end of the leg, if it is worth flying. frees:
    that end is clear.
    """

    lacking: bool
    leg_m: PlanePoint | None = None
    frees: bool = False


class Refuge:
    """Keeps the threats to the aircraft's place, and begins legs to a refuge."""

    def __init__(
        self, vehicle: Vehicle, limits: Supervision, risk_monitor: RiskMonitor, reports: Reports
    ) -> None:
        self.take_settings(vehicle, limits)
        self._risk_monitor = risk_monitor
        self._reports = reports
        self._due_s = -math.inf
        self._look_due_s = -math.inf
        self._said: set[str] = set()
        """Threats of which it was reported that no place is clear."""
        self._best_m: PlanePoint | None = None
        """Place from where no leg leads to one better against a position error; None: not known."""
        self._blind_until_s: float | None = None
        """Time until which a leg may begin for the lost fix, once; None: there is a fix."""
        self._spare_m: dict[Failsafes, FloatArray] = {}
        """Drift to spare in the cells of `_spare_maps`."""
        self._spare_maps: Maps | None = None
        self._expected_s = math.inf
        """Time of the battery's action by the first forecast of the threat."""
        self._threatened_s = -math.inf
        """Time at which it threatened last."""
        self.blind_hit: str | None = None
        """Text for the autopilot's action without a position that would hit an obstacle here."""
        self.battery_landing: str | None = None
        """Text for a battery's action that comes before the escape route is clear of it."""

    def take_settings(self, vehicle: Vehicle, limits: Supervision) -> None:
        """Takes the settings in force."""
        self._vehicle = vehicle
        self._limit_m = limits.position_uncertainty_limit_m
        self._power = PowerModel.of(vehicle)

    def look(
        self,
        volume: FlightVolume,
        failsafes: Failsafes,
        place_m: Vector | None,
        landing: tuple[FailsafeAction, float] | None,
        leaving_s: float | None,
        now_s: float,
        *,
        blind: bool,
        leaves: bool,
    ) -> None:
        """Updates the threats to a place; they stay where that is unknown.

        blind: the receiver has no fix. leaves: a leg to a refuge is flown. landing: the battery's
        next action that moves the aircraft, and the time until it. leaving_s: time until the escape
        route has left all places from where that hits an obstacle.
        """
        if (self._risk_monitor.uncertainty_m(AHEAD_S) or 0.0) <= self._limit_m:
            self._best_m = None  # the position is certain again
        if not blind:
            self._blind_until_s = self.blind_hit = None
        elif self._blind_until_s is None:
            self._blind_until_s, self._look_due_s = now_s + _BLIND_BEGINS_S, -math.inf
        if place_m is None or now_s < self._look_due_s:
            return
        self._look_due_s = now_s + _AGAIN_S
        here_m = (place_m[0], place_m[2])
        counts = blind and (leaves or self._blind_leg_may_begin(now_s))
        self.blind_hit = self._blind_hit(volume, failsafes.of(_BLIND), here_m) if counts else None
        self.battery_landing = None
        if landing is None or leaving_s is None or not landing[1] < leaving_s:
            return
        if now_s - self._threatened_s > _OVER_S:
            self._expected_s = now_s + landing[1]
        self._threatened_s = now_s
        if now_s > self._expected_s + _OVERDUE_S:
            return
        needed_s = self._refuge_s(volume, failsafes, here_m)
        if needed_s is not None and needed_s < leaving_s:
            left_s, noun = seconds(math.floor(landing[1])), landing[0].action.noun
            self.battery_landing = f"{noun} {left_s} s < {seconds(math.ceil(leaving_s))} to leave"

    def _blind_leg_may_begin(self, now_s: float) -> bool:
        return self._blind_until_s is not None and now_s < self._blind_until_s

    def is_best(self, place_m: Vector) -> bool:
        """True if the last search found no place better against a position error than this one."""
        x_m, _, z_m = place_m
        best_m = self._best_m
        return best_m is not None and math.dist(best_m, (x_m, z_m)) < _ELSEWHERE_M

    def act(
        self,
        flight: PathFollower | None,
        failsafes: Failsafes,
        status: MissionStatus,
        ruling: Ruling,
        now_s: float,
        *,
        landing_due: bool,
    ) -> None:
        """Runs one cycle: begins a leg to a refuge, or a further one, or ends it.

        landing_due: LAND is requested, which must not be left.
        """
        holds = (
            status.state is MissionState.HOLDING and status.requested is None and not landing_due
        )
        leaves = holds and ruling.action is Action.LEAVE
        if flight is None or not holds:
            self._said.clear()
        if flight is None:
            return
        if flight.leaves and not leaves:
            flight.brake()
        if flight.leaves or not holds or not flight.stopped or now_s < self._due_s:
            return
        volume, place_m = flight.path.volume, flight.path.place_m
        here_m = place_m[0], place_m[2]
        if leaves:
            self._due_s = now_s + _AGAIN_S
            threats = _Threats(
                error=ruling.acts("error_reach"),
                blind=ruling.acts("blind_landing") and self._blind_leg_may_begin(now_s),
                battery=ruling.acts("battery_landing"),
            )
            found = self._search(volume, failsafes, here_m, threats)
            if threats.blind:
                self._blind_until_s = -math.inf  # no second leg, also where the first one helps not
            if found.leg_m is not None:
                flight.begin_leaving(found.leg_m)
                return
            if threats.error:
                self._best_m = here_m if found.lacking else None
            if ruling.acts("blind_landing"):
                self._warn_blind(volume, failsafes, here_m, now_s)
        self._warn(volume, here_m, now_s)

    def _warn(self, volume: FlightVolume, here_m: PlanePoint, now_s: float) -> None:
        """Reports once that the position's uncertainty reaches an obstacle from the best place."""
        known_m = self._risk_monitor.uncertainty_m(0.0)
        if known_m is None or self._best_m is None or "error" in self._said:
            return
        room_m = float(obstacle_room_m(volume.site, np.array(here_m))) - self._vehicle.radius_m
        if known_m > room_m + volume.site.margin.total_m:
            self._said.add("error")
            text = pilot_texts.NO_REFUGE(m=distance(known_m))
            self._reports.send_text(Severity.WARNING, text, now_s)

    def _warn_blind(
        self, volume: FlightVolume, failsafes: Failsafes, here_m: PlanePoint, now_s: float
    ) -> None:
        """Reports once that the autopilot's landing without a position hits an obstacle."""
        hit = self._blind_hit(volume, failsafes.of(_BLIND), here_m)
        if hit is not None and "blind" not in self._said:
            self._said.add("blind")
            self._reports.send_text(Severity.WARNING, pilot_texts.NO_BLIND_REFUGE(), now_s)

    def _search(
        self, volume: FlightVolume, failsafes: Failsafes, here_m: PlanePoint, threats: _Threats
    ) -> _Found:
        """The leg from a place to its refuge, if that is better by a worthwhile distance."""
        maps, here = volume.maps, np.array([here_m])
        kept_m = volume.site.margin.position_m
        needed_m = (self._risk_monitor.uncertainty_m(_LASTS_S) or 0.0) - kept_m
        room_m = obstacle_room_m(volume.site, here) - self._vehicle.radius_m
        acting = failsafes.of(
            (_BLIND if threats.blind else frozenset())
            | (BATTERY if threats.battery else frozenset())
        )
        spare_m = float(spare_at_m(acting, volume.site, self._vehicle, maps, here)[0])
        if threats.error:
            spare_m = min(spare_m, float(room_m[0]) - needed_m)
        if spare_m >= 0.0:
            return _Found(lacking=False)
        at_m = self._spare_in_cells_m(acting, volume)
        if threats.error:
            at_m = np.minimum(at_m, maps.room_m - needed_m)
        widened_m = (self._risk_monitor.uncertainty_m(AHEAD_S) or 0.0) - kept_m
        widened_m = max(0.0, widened_m + (_BLIND_M if threats.blind else 0.0))
        longest_m = BLIND_LEG_M if threats.blind else math.inf
        end_m = refuge_leg(volume.site, self._vehicle, maps, here_m, at_m, widened_m, longest_m)
        cell = None if end_m is None else maps.grid.cell_of(end_m)
        if cell is None or not (at_m[cell] >= 0.0 or at_m[cell] > spare_m + _WORTH_M):
            return _Found(lacking=True)
        return _Found(lacking=True, leg_m=end_m, frees=bool(at_m[cell] >= 0.0))

    def _spare_in_cells_m(self, failsafes: Failsafes, volume: FlightVolume) -> FloatArray:
        """As `spare_in_cells_m`; kept, as it does not depend on the aircraft."""
        if self._spare_maps is not volume.maps or len(self._spare_m) >= _CACHED:
            self._spare_maps, self._spare_m = volume.maps, {}
        spare_m = self._spare_m.get(failsafes)
        if spare_m is None:
            spare_m = spare_in_cells_m(failsafes, volume.site, self._vehicle, volume.maps)
            self._spare_m[failsafes] = spare_m
        return spare_m

    def _blind_hit(
        self, volume: FlightVolume, failsafes: Failsafes, here_m: PlanePoint
    ) -> str | None:
        place, maps = np.array([here_m]), volume.maps
        if (spare_at_m(failsafes, volume.site, self._vehicle, maps, place) >= 0.0).all():
            return None
        found = failsafe_hit(failsafes, maps.reach, place, drifting=True)
        if found is None:
            return None
        pattern = f"no fix: {found[0].action.noun} hits {{}}"
        return with_name(pattern, found[1].obstacle, reason_chars("rejected"))

    def _refuge_s(
        self, volume: FlightVolume, failsafes: Failsafes, here_m: PlanePoint
    ) -> float | None:
        """Time of the leg to a place from where a battery's action hits nothing; None: no such."""
        threats = _Threats(error=False, blind=False, battery=True)
        found = self._search(volume, failsafes, here_m, threats)
        if not found.lacking:
            return 0.0
        if found.leg_m is None or not found.frees:
            return None
        (x_m, z_m), (end_x_m, end_z_m) = here_m, found.leg_m
        length_m = math.hypot(end_x_m - x_m, end_z_m - z_m)
        cruise_s = straight_s((x_m, 0.0, z_m), (end_x_m, 0.0, end_z_m), self._power)
        return max(cruise_s, 2.0 * math.sqrt(length_m / self._vehicle.guidance.acceleration_mps2))
