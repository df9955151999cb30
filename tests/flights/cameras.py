"""Sites with views, and the camera and gimbal on board of a flight in lockstep."""

from __future__ import annotations

from dataclasses import replace

from moar_companion.planner.site import Site, Target, TargetView
from sitl.geodesy import Geodetic
from sitl.payload import PayloadOptions
from sitl.picture import PictureScene


def with_views(site: Site, *, pictures: int = 2, video_s: float = 0.0) -> Site:
    """The site with one view of each of its targets, from the target's place."""
    targets = tuple(
        replace(
            target,
            name=f"{target.name}/1",
            dwell_s=0.0,
            view=TargetView(
                target=target.name,
                number=1,
                aim_m=target.look_at_m or target.position_m,
                pictures=pictures,
                video_s=video_s,
            ),
        )
        for target in site.targets
    )
    return replace(site, targets=targets)


def payload_of(site: Site, **options) -> PayloadOptions:
    """Camera and gimbal that see the site's wires, and its aims by the names of their stops."""
    origin = site.frame.origin
    scene = PictureScene(
        name=site.name,
        origin=Geodetic(
            latitude_deg=origin.latitude_deg,
            longitude_deg=origin.longitude_deg,
            altitude_amsl_m=origin.altitude_amsl_m,
        ),
        azimuth_deg=site.frame.azimuth_deg,
        wires=tuple((*item.position_m, 2.0 * item.radius_m) for item in site.conductors),
        points=aims(site.targets),
    )
    return PayloadOptions(scene=scene, **options)


def aims(targets: tuple[Target, ...]) -> dict[str, tuple[float, float]]:
    return {target.name: target.view.aim_m for target in targets if target.view is not None}
