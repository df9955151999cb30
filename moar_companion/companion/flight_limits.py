"""Limits of a flight: the site's maps, and the autopilot's fence, offboard loss and failsafes.

Inputs: maps, the autopilot's parameters, fence and home. Outputs: the flight volume, and reasons
against the active flight.
"""

from __future__ import annotations

import numpy as np

from ..mavlink.autopilots import profile
from ..mavlink.autopilots.offboard_loss import OffboardLoss
from ..mavlink.autopilots.parameter_names import Parameters
from ..mavlink.autopilots.profile import Unreported
from ..mavlink.session import Session, Severity
from ..planner.plane_fence import PlaneFence
from ..risk.power import PowerModel
from ..settings.config import CompanionConfig
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..texts.text_format import plural
from ..types import AutopilotKind
from .estimation.pose import Pose
from .estimation.pose_tracker import PoseTracker
from .estimation.site_fence import SiteFence, fenced
from .guidance.flight_volume import FlightVolume
from .guidance.path_follower import PathFollower
from .offboard_loss_check import OffboardLossCheck
from .planning.site_maps import SiteMaps
from .reports import Reports
from .safety.failsafe_exposure import FailsafeExposure


class FlightLimits:
    """The limits at present. Before `take_ground` no flight is possible."""

    def __init__(self, vehicle: Vehicle, config: CompanionConfig, reports: Reports) -> None:
        self.site_maps: SiteMaps | None = None
        """Site and maps, with the obstacles of the sensor; None without a site."""
        self.maps_changed = False
        """True once the maps have changed in flight."""
        self.obstacles_seen = False
        """True once they have changed by obstacles that the sensor sees."""
        self._vehicle = vehicle
        self._config = config
        self._reports = reports
        self._fences = SiteFence(None, config.supervision.fence_margin_m)
        self.unreported = Unreported()
        """Parameters that the autopilot never reported."""
        self._reported: tuple[str, ...] = ()
        """Names of the last text about them."""
        self._kind: AutopilotKind | None = None
        self._parameters = Parameters({})
        """As they were read last, and the offboard loss by them."""
        self._loss: OffboardLoss | None = None
        self.fence: PlaneFence | None = None
        """Part of the autopilot's fence that cuts the site: plans stay inside."""
        self.watch = FailsafeExposure(config.supervision, PowerModel.of(vehicle))
        """Autopilot failsafes."""
        self.offboard_loss = OffboardLossCheck(vehicle, config.supervision, reports)

    def take_settings(self, vehicle: Vehicle, config: CompanionConfig) -> None:
        """Takes the settings in force."""
        self._vehicle, self._config = vehicle, config
        self._fences.take_margin(config.supervision.fence_margin_m)
        self.watch.take_settings(config.supervision, PowerModel.of(vehicle))
        self.offboard_loss.take_vehicle(vehicle)
        self._take_fence()

    @property
    def not_ready_reason(self) -> str | None:
        """Reason why no mission can start; None once offboard-loss action and fence are known."""
        if not self.offboard_loss.loss or not self.watch.known:
            return "autopilot parameters not read yet"
        return None if self.site_maps is None else self._fences.not_ready_reason

    @property
    def volume(self) -> FlightVolume | None:
        """Flight volume of the vehicle; None before offboard-loss action and fence were known.

        With the last known fence, if the present one is unknown: a flight must not end by that.
        """
        site_maps, loss = self.site_maps, self.offboard_loss.loss
        if site_maps is None or loss is None or not self._fences.is_placed:
            return None
        return FlightVolume(
            site=site_maps.site,
            vehicle=self._vehicle,
            maps=site_maps.maps,
            loss=loss,
            fence=self._fences.plane,
        )

    def clearance_m(self, pose: Pose | None) -> float | None:
        """Distance from the hull at a place to the nearest obstacle; None where unknown."""
        if pose is None or self.site_maps is None:
            return None
        return self.site_maps.clearance_m(pose, self._vehicle.radius_m)

    def take_ground(self, site_maps: SiteMaps) -> None:
        """Takes the site and its maps."""
        self.site_maps = self.offboard_loss.site_maps = site_maps
        self._fences = SiteFence(site_maps.site, self._config.supervision.fence_margin_m)

    def learn_maps(
        self,
        site_maps: SiteMaps,
        flight: PathFollower | None,
        now_s: float,
        *,
        for_settings: bool = False,
    ) -> None:
        """Takes maps of the site with other obstacles; brakes where they bar the path ahead.

        for_settings: the obstacles are the same, and the settings are others.
        """
        self.site_maps, self.maps_changed = site_maps, True
        self.obstacles_seen = self.obstacles_seen or not for_settings
        volume = self.volume
        if flight is not None and volume is not None:
            flight.learn_maps(volume)
            flight.avoid(seen=not for_settings)
        self.offboard_loss.learn_maps(site_maps, flight, now_s)

    def learn(
        self,
        session: Session,
        tracker: PoseTracker,
        flight: PathFollower | None,
        now_s: float,
    ) -> None:
        """Takes the autopilot's parameters, fence and failsafes, by its home on the site."""
        home_m = tracker.home_m
        if session.autopilot is None:
            return
        kind, parameters = session.autopilot.kind, session.requests.parameters
        if kind is not self._kind or not parameters.are(self._parameters):
            self._kind, self._parameters = kind, parameters.as_of_now()
            self._learn_unreported(kind, parameters, now_s)
            self._loss = profile(kind).offboard_loss(parameters)
        self.offboard_loss.learn(self._loss, home_m, flight, now_s)
        self._learn_fence(session, tracker, flight)
        if self.watch.learn(kind, parameters, home_m, session.telemetry):
            self.offboard_loss.reconsider(flight)

    def _learn_fence(
        self, session: Session, tracker: PoseTracker, flight: PathFollower | None
    ) -> None:
        """Takes the autopilot's fence. An uploaded one that it does not report counts as none."""
        assert session.autopilot is not None
        requests, readiness = session.requests, session.telemetry.readiness
        items = requests.fence_items
        if items is None and requests.fence_silent:
            items = ()
        before = self._fences.plane
        self._fences.learn(
            session.autopilot.kind,
            requests.parameters,
            items,
            tracker.home_m,
            enabled=readiness is not None and readiness.fence_enabled,
            offset_x_m=tracker.offset_m[0],
        )
        plane = self._fences.plane
        if self.site_maps is None or plane == before:
            return
        self._take_fence()
        if flight is not None:
            flight.learn_fence(plane)

    def _take_fence(self) -> None:
        """Takes the part of the fence that cuts the site, with the ends of its landing legs."""
        if self.site_maps is not None:
            height_m = self._vehicle.guidance.landing_height_m
            self.fence = fenced(self._fences.plane, self.site_maps.site, height_m)

    def _learn_unreported(self, kind: AutopilotKind, parameters: Parameters, now_s: float) -> None:
        """Takes the parameters that the autopilot never sent; reports them when none is awaited."""
        known = profile(kind)
        self.unreported = known.unreported(parameters)
        names = self.unreported.names
        if names == self._reported or any(key not in parameters for key in known.flight_parameters):
            return
        self._reported = names
        if names:
            text = pilot_texts.UNREPORTED(
                count=len(names), plural=plural(len(names)), detail=", ".join(names)
            )
            self._reports.send_text(Severity.WARNING, text, now_s)

    def fence_objection(self, flight: PathFollower | None, pose: Pose | None) -> str | None:
        """Reason against the active flight by the autopilot's present fence; None if there is none.

        The aircraft itself may be within the margin, where the wind pushes it.
        """
        plane = self._fences.plane
        if plane is None or flight is None:
            return None
        if pose is not None:
            place_m = np.array([pose.position_m])[:, ::2]
            crossed = plane.crossed(place_m, plane.margin_m)
            if crossed is not None:
                return f"outside {crossed}"
        crossed = flight.path.leaves_fence()
        return None if crossed is None else f"path past {crossed}"
