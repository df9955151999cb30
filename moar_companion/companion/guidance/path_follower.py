"""The path follower: from plans to this instant's setpoint.

A reference moves along a trajectory (`flown_path`). Every new plan begins at a point of the present
trajectory beyond the stopping distance of the reference. Any plan can therefore be joined without a
jump; the rest of the trajectory leads to it. Only for an aircraft off its path does a plan begin
at the aircraft; the setpoint then moves over to it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...mavlink.autopilots.offboard_loss import OffboardLoss
from ...planner.adaptation import Adaptation
from ...planner.free_distance import FreeDistance
from ...planner.plan_values import Plan
from ...planner.plane_fence import PlaneFence
from ...planner.site import PlanePoint
from ...settings.vehicle import Vehicle
from ...status_values import PathSection, SetpointEntry
from ...texts import pilot_texts
from ...texts.text_format import distance
from ...types import Mission, Vector
from ..estimation.plane_to_local import PlaneToLocal
from ..estimation.pose import Jump, Pose, Setpoint
from ..safety.setpoint_gate import Refusal
from .flight_volume import FlightVolume
from .flown_path import FlownPath
from .plan_path import vector
from .splice import Adoption, Splice
from .tracking import Reference, WindLeash, advanced
from .trajectory import FloatArray
from .yaw import turned, wanted_yaw_rad

_STOPPED_MPS = 0.05
"""Speed below any planned speed, even at half its pace: the residue of a waiting reference."""


class PathFollower:
    """Keeps the flown path with its plan, the displacement by wind, and the heading.

    Invariant: if the setpoint stream stops now, the aircraft stops in free space. This caps the
    speed next to obstacles.
    """

    def __init__(self, volume: FlightVolume, pose: Pose) -> None:
        """Sets the setpoint to the aircraft's pose."""
        self._path = FlownPath.at(volume, pose.position_m)
        self._plan: Plan | None = None
        self._drift = WindLeash()
        self._yaw_rad = pose.yaw_rad
        self._leaves = False
        self.seen_late = False
        """True if an obstacle was seen nearer than the stopping distance, until the next plan."""

    @property
    def path(self) -> FlownPath:
        """The path that is flown, at this instant: its flight volume, its rest, its limits."""
        return self._path

    @property
    def _reference(self) -> Reference:
        return self._path.reference

    @property
    def _volume(self) -> FlightVolume:
        return self._path.volume

    @property
    def _vehicle(self) -> Vehicle:
        return self._volume.vehicle

    @property
    def arrived(self) -> bool:
        """True if the setpoint is at the plan's end; a stop by a brake does not count."""
        return self._reference.arrived and not self.braked and not self._on_leg_by_itself

    @property
    def braked(self) -> bool:
        """True while the flight comes to rest, or stands, before its plan's end."""
        return self._reference.stop_m is not None

    @property
    def stopped(self) -> bool:
        """True if the setpoint does not move, or hardly."""
        return math.hypot(*self._reference.velocity_mps) < _STOPPED_MPS

    @property
    def mission(self) -> Mission | None:
        """Mission of the active plan, also after a brake; None before the first plan."""
        return None if self._plan is None else self._plan.mission

    @property
    def adaptation(self) -> Adaptation | None:
        """Adaptation of the active plan's weights; None before the first plan."""
        return None if self._plan is None else self._plan.request.adaptation

    @property
    def on_leg(self) -> bool:
        """True while the reference is on the landing leg."""
        return self._path.on_leg

    @property
    def drifting_at_m(self) -> Vector | None:
        """Position of an aircraft that has just moved its setpoint by drift; None otherwise."""
        return self._drift.moved_to_m

    @property
    def recovers(self) -> bool:
        """True while the flight returns by a recovery leg, without a plan."""
        return self._drift.recovers

    @property
    def leaves(self) -> bool:
        """True while the flight goes to a refuge, without a plan."""
        return self._leaves

    @property
    def _on_leg_by_itself(self) -> bool:
        """True on a recovery leg or one to a refuge, which are flown during a hold."""
        return self.recovers or self._leaves

    @property
    def stop_m(self) -> Vector:
        """Place where the setpoint would stop if it braked now."""
        stop_m = self._reference.stopping_m(self._vehicle.guidance.acceleration_mps2)
        return vector(self._reference.trajectory.at(stop_m)[0])

    def drifted_m(self, pose: Pose) -> float | None:
        """Distance that the wind has moved the aircraft; None while it holds."""
        from_m = self._drift.from_m
        return None if from_m is None else math.dist(from_m, pose.position_m)

    @property
    def recovery_text(self) -> str:
        """Text for operators about the recovery leg."""
        return pilot_texts.RETURNING(m=distance(self._path.outside_m))

    @property
    def must_recover(self) -> bool:
        """True if the setpoint, after a displacement by wind, needs a recovery leg to continue."""
        displaced = self._drift.carried and self._drift.from_m is None
        return displaced and self._path.needs_recovery

    def begin_recovery(self, widened_m: float) -> bool:
        """Begins the recovery leg at the setpoint; returns False if there is none."""
        path = self._path.recovery(widened_m)
        if path is None:
            return False
        self._path = path
        self._drift = WindLeash(recovers=True)
        return True

    def begin_leaving(self, end_m: PlanePoint) -> None:
        """Begins the straight leg, checked before, to a refuge in the plane."""
        self._path = self._path.leaving(end_m)
        self._drift, self._leaves = WindLeash(), True

    def shift(self, jump: Jump) -> None:
        """Moves the setpoint with an estimate that jumped, so that the aircraft does not follow."""
        reference = self._reference
        self._path = replace(
            self._path,
            reference=replace(reference, offset_m=reference.offset_m + np.array(jump.step_m)),
        )
        self._yaw_rad = math.remainder(self._yaw_rad + jump.turn_rad, math.tau)

    def take_heading(self, pose: Pose) -> None:
        """Sets the setpoint's heading to the aircraft's."""
        self._yaw_rad = pose.yaw_rad

    def take_vehicle(self, vehicle: Vehicle) -> None:
        """Takes settings of which no path is made, as of the heading."""
        self._path = replace(self._path, volume=replace(self._volume, vehicle=vehicle))

    def learn_loss(self, loss: OffboardLoss) -> None:
        """Caps the speed by the new offboard-loss behaviour."""
        self._path = self._path.within(replace(self._volume, loss=loss))

    def learn_fence(self, fence: PlaneFence | None) -> None:
        """Takes the autopilot's new fence, and caps the speed by it."""
        self._path = self._path.within(replace(self._volume, fence=fence))

    def learn_maps(self, volume: FlightVolume) -> None:
        """Takes a flight volume with other obstacles or settings, and caps the speed by them.

        The active plan's inflation counts no longer: the gate has the present one.
        """
        self._path = self._path.on_maps(volume.widened(None, self._volume.narrowed_m))

    @property
    def barred_by(self) -> str | None:
        """Name of the obstacle by which the maps bar the path ahead; None: it is free."""
        barred_m = self._path.barred_m()
        if barred_m is None or not self._volume.site.obstacles:
            return None
        x_m, _, z_m = vector(self._reference.trajectory.at(barred_m)[0])
        return self._volume.maps.reach.nearest((x_m, z_m))

    def is_barred_on(self, volume: FlightVolume) -> bool:
        """True if other maps bar a place nearer than the stopping distance."""
        path = self._path.on_maps(volume.widened(None, self._volume.narrowed_m))
        barred_m = path.barred_m()
        stop_m = self._reference.stopping_m(self._vehicle.guidance.acceleration_mps2)
        return barred_m is not None and barred_m <= stop_m

    def has_room_on(self, volume: FlightVolume, plane_tolerance_m: float) -> bool:
        """True if the setpoint's place is permitted in another flight volume as in the present one.

        At rest, and moving where it is in the present one: within the margin an aircraft may rest,
        and not fly on. On a leg: if the rest of that can be flown there.
        """
        return self._is_permitted(volume, plane_tolerance_m, moves=False) and (
            self._is_permitted(volume, plane_tolerance_m, moves=True)
            or not self._is_permitted(self._volume, plane_tolerance_m, moves=True)
        )

    def _is_permitted(self, volume: FlightVolume, plane_tolerance_m: float, *, moves: bool) -> bool:
        """True if the setpoint's place is permitted in a flight volume, without inflation."""
        velocity_mps = (_STOPPED_MPS if moves else 0.0, 0.0, 0.0)
        setpoint = replace(self._setpoint(), velocity_mps=velocity_mps)
        legs = (volume.rechecked(leg, setpoint.position_m) for leg in self._path.legs)
        reason = volume.refusal(
            setpoint,
            tuple(leg for leg in legs if not leg.barred),
            plane_tolerance_m=plane_tolerance_m,
            widened_m=0.0,
            carried_from_z_m=self._drift.lowest_m if self._drift.carried else None,
            brakes=True,
        )
        return reason is None

    def avoid(self, *, seen: bool = True) -> None:
        """Brakes before a barred place where the next plan could not begin before it.

        On a leg no next plan begins. seen: what bars it may be an obstacle that was seen late.
        """
        barred_m = self._path.barred_m()
        stop_m = self._reference.stopping_m(self._vehicle.guidance.acceleration_mps2)
        near = barred_m is not None and barred_m <= stop_m
        self.seen_late = near and (seen or self.seen_late)
        if barred_m is None:
            return
        joined_m = self._path.junction().joined_m
        if self.on_leg or self._on_leg_by_itself or (joined_m is not None and joined_m >= barred_m):
            self.brake()

    def error_m(self, pose: Pose) -> float:
        """Distance from the setpoint to the aircraft, in metres."""
        return math.dist(self._reference.position_m, pose.position_m)

    def brake(self) -> None:
        """Brakes to rest as soon as the acceleration limit permits."""
        if self.recovers:
            self._drift = WindLeash(carried=True)
        self._leaves = False
        if not self.braked:
            self._path = self._path.braked()

    def stop_at(self, position_m: Vector) -> None:
        """Stops at once at a place that the path has just passed.

        Later plans begin there, on any path; a landing leg is kept within its corridor.
        """
        self._path, self._leaves = self._path.stopped_at(position_m), False

    def resume_leg(self, widened_m: float) -> bool:
        """Resumes along the landing leg (`FlownPath.resumed`); returns False where it must not."""
        path = self._path.resumed(widened_m)
        if path is None:
            return False
        self._path = path
        return True

    def leads_to(self, mission: Mission, goal: str | int | None) -> bool:
        """True if the active plan has this mission and this target or landing point."""
        plan = self._plan
        return plan is not None and (plan.mission, plan.request.target) == (mission, goal)

    def resumed_near_leg(
        self, volume: FlightVolume, pose: Pose, widened_m: float
    ) -> PathFollower | None:
        """Flight resumed near its landing leg after a takeover (`FlownPath.resumed_near_leg`)."""
        path = self._path.resumed_near_leg(volume, pose, widened_m)
        if path is None:
            return None
        flight = PathFollower(volume, pose)
        flight._plan, flight._path = self._plan, path
        return flight

    def adopt(
        self,
        plan: Plan,
        junction: Splice,
        escape_m: tuple[PlanePoint, ...],
        reach: FreeDistance | None = None,
        narrowed_m: float = 0.0,
    ) -> Adoption:
        """Adopts a plan that begins at a junction, if the junction is still ahead.

        reach: to obstacles with the plan's inflation; None: no inflation. narrowed_m: part of the
        margin that the plan omits.
        """
        path = self._path.joined(plan, junction, escape_m, reach, narrowed_m)
        if path is None:
            return Adoption.TOO_LATE
        self._plan = plan
        if path is self._path:
            return Adoption.SAME_PATH
        self._path, self._drift = path, WindLeash()
        self.seen_late = self._leaves = False
        return Adoption.NEW_PATH

    def rest_of_plan(
        self, newer: Plan, junction: Splice, reach: FreeDistance | None
    ) -> Plan | None:
        """Rest of the active plan, as an answer to the newer plan's request.

        None where the active plan must not stay: its goal differs, its path is not free any more,
        or the flight volume or the settings have changed. reach: as in `adopt`.
        """
        plan = self._plan
        if (
            plan is None
            or junction.trajectory is not self._reference.trajectory
            or reach != self._volume.reach
            or self._path.outdated
            or self._path.leaves_fence() is not None
            or (plan.mission, plan.request.target) != (newer.mission, newer.request.target)
        ):
            return None
        return junction.rest_of(plan, newer, self._volume.maps)

    def advance(self, pose: Pose, step_s: float, pace: float = 1.0, *, holds: bool = False) -> None:
        """Moves the reference by one step, slower if the aircraft falls behind.

        pace: flown fraction of the planned speed. holds: the aircraft holds. Then, as after a
        brake, the setpoint comes to rest where it is, and its path begins there.
        """
        self._go_along(pose, step_s)
        if self._on_leg_by_itself and self._reference.arrived:
            self.brake()
        stays = (holds or self.braked) and not self._on_leg_by_itself
        reference = advanced(
            self._reference,
            pose.position_m,
            self._vehicle.guidance,
            0.0 if stays else self._path.fade_mps(),
            step_s,
            pace,
        )
        self._path = replace(self._path, reference=reference)
        beside = reference.offset_m.any() and not reference.speed_mps
        if stays and beside and not self.on_leg:
            self.stop_at(vector(reference.position_m))

    def _go_along(self, pose: Pose, step_s: float) -> None:
        """Moves the setpoint, at rest, to an aircraft beyond the leash or a seen obstacle."""
        leash_m = self._drift.leash_m(self._vehicle)
        place_m, error_m = self._path.place_m, self.error_m(pose)
        slow_m, moved_m, drifts = self._vehicle.guidance.tracking_slow_m, None, error_m > leash_m
        if drifts:
            moved_m = self._volume.carried_m(place_m, pose.position_m, leash_m)
        elif error_m > slow_m and not self._volume.is_free_leg(pose.position_m, place_m):
            nearer_m = error_m - 0.5 * self._volume.maps.grid.resolution_m
            moved_m = self._volume.carried_m(place_m, pose.position_m, nearer_m)
        if moved_m is None:
            self._drift = self._drift.after(error_m, leash_m, pose, step_s)
            return
        self._path = replace(self._path, legs=(), landing_corner=None).stopped_at(moved_m)
        self._drift, self._leaves = self._drift.pulled(place_m, pose, drifts=drifts), False

    def setpoint(self, pose: Pose, plane: PlaneToLocal, step_s: float) -> Setpoint:
        """The setpoint of this instant, the heading turned by one step (0: kept)."""
        guidance = self._vehicle.guidance
        wanted = wanted_yaw_rad(
            self._volume.site,
            guidance,
            self._plan,
            pose,
            plane,
            velocity_mps=vector(self._reference.velocity_mps),
            arrived=self.arrived,
        )
        if wanted is not None:
            self._yaw_rad = turned(self._yaw_rad, wanted, guidance.yaw_rate_radps * step_s)
        return self._setpoint()

    def _setpoint(self) -> Setpoint:
        return Setpoint(
            position_m=vector(self._reference.position_m),
            velocity_mps=vector(self._reference.velocity_mps),
            yaw_rad=self._yaw_rad,
        )

    @property
    def left_m(self) -> float:
        """Distance along the path to its end."""
        return max(0.0, self._reference.trajectory.length_m - self._reference.distance_m)

    def corners_m(self, *, ahead: bool = False) -> tuple[Vector, ...]:
        """Points at which the path begins, turns or ends, for displays.

        ahead: those that the setpoint has not passed.
        """
        from_m = self._reference.distance_m if ahead else None
        return tuple(vector(point) for point in self._reference.trajectory.corners_m(from_m))

    def progress(self, pose: Pose) -> PathSection:
        """Progress of the flight, for displays."""
        setpoint = self._setpoint()
        return PathSection(
            setpoint=SetpointEntry(
                position_m=setpoint.position_m,
                velocity_mps=setpoint.velocity_mps,
                yaw_rad=setpoint.yaw_rad,
            ),
            error_m=self.error_m(pose),
            left_m=self.left_m,
            left_s=self._reference.trajectory.duration_s(self._reference.distance_m),
        )

    def excursion(self, pose: Pose) -> str | None:
        """Text for an aircraft outside both the workspace and its checked legs; None: it is not.

        An aircraft on a recovery leg counts as outside until the leg's end.
        """
        if self.recovers:
            return self.recovery_text
        return self._volume.excursion(pose, self._path.legs)

    def refusal(
        self,
        setpoint: Setpoint,
        plane_tolerance_m: float,
        widened_m: float,
        sudden_m: float = 0.0,
    ) -> Refusal | None:
        """Reason to refuse a setpoint; None when the setpoint is permitted.

        sudden_m: depth in a keep-out at which a setpoint may rest before an obstacle that was seen
        late.
        """
        return self._volume.refusal(
            setpoint,
            self._path.legs,
            plane_tolerance_m=plane_tolerance_m,
            widened_m=widened_m,
            carried_from_z_m=self._drift.lowest_m if self._drift.carried else None,
            brakes=self.braked,
            sudden_m=sudden_m if self.seen_late else 0.0,
        )

    def rests_m(
        self,
        plan: Plan,
        junction: Splice,
        escape_m: tuple[PlanePoint, ...],
        reach: FreeDistance | None = None,
    ) -> FloatArray:
        """Possible stop points (n, 2) if the setpoint stream ends on a plan.

        reach: as in `adopt`.
        """
        volume = self._volume.widened(reach)
        return volume.rests_m(volume.trajectory(self._path.points(plan, junction, escape_m)))
