"""Pictures of a demonstration: views for the site's targets, the camera's scene, and the judge.

Inputs: the site file; after the flight the record of the inspection and the pictures as they truly
are. Outputs: the site file with views, the scene, faults.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from moar_companion.planner.site import Site
from sitl.geodesy import Geodetic
from sitl.payload import PayloadOptions
from sitl.payload_sender import PayloadSender
from sitl.picture import PictureScene

SITE, SCENE, FOLDER = "site.yaml", "camera_scene.yaml", "pictures"
"""Names in the flight's folder."""
_PICTURES = 2
"""Of each view."""
_MIDDLE = 0.1
"""Part of the picture's width and height from its middle to the edge of its middle fifth."""


OWN_PARAMETERS: Mapping[str, Mapping[str, float]] = {
    "px4": {"MNT_MODE_IN": 4, "MNT_MODE_OUT": 0, "TRIG_MODE": 1, "TRIG_INTERFACE": 3},
    "ardupilot": {
        "MNT1_TYPE": 1,
        "CAM1_TYPE": 1,
        "SERVO9_FUNCTION": 7,
        "SERVO10_FUNCTION": 6,
        "SERVO11_FUNCTION": 10,
    },
}
"""Parameters of a real autopilot's own gimbal and camera: PX4's gimbal module with the input of
MAVLink v2 and servo outputs, and its camera trigger; ArduPilot's mount and camera of servos."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Photographing:
    """Files of one flight. site: with views. own: the real autopilot has camera and gimbal."""

    site: Site
    file: Path
    scene: Path
    folder: Path
    own: bool

    def arguments(self, port: int) -> tuple[str, ...]:
        """Arguments of the fake autopilot. port: the companion's."""
        camera = ("--camera", f"127.0.0.1:{port}", "--camera-scene", str(self.scene))
        return (*camera, "--pictures", str(self.folder))

    def sender(self, port: int) -> PayloadSender:
        """Camera and gimbal on a real autopilot's aircraft."""
        options = PayloadOptions(scene=PictureScene.load(self.scene))
        return PayloadSender(options, "127.0.0.1", port, self.folder)


def prepare(folder: Path, site_file: Path, *, own: bool) -> Photographing:
    """Writes the site file, in which each target beside a conductor has a view, and the scene."""
    document = yaml.safe_load(site_file.read_text(encoding="utf-8"))
    for target in document["targets"].values():
        if "standoff_m" in target and "views" not in target:
            place = {key: target.pop(key) for key in ("standoff_m", "side")}
            target["views"] = [{**place, "pictures": _PICTURES}]
    file, scene = folder / SITE, folder / SCENE
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    site = Site.load(file)
    scene.write_text(camera_scene(site).text(), encoding="utf-8")
    return Photographing(site=site, file=file, scene=scene, folder=folder / FOLDER, own=own)


def camera_scene(site: Site) -> PictureScene:
    """The site's conductors, and the aims of its views by the names of their stops."""
    origin = site.frame.origin
    return PictureScene(
        name=site.name,
        origin=Geodetic(
            latitude_deg=origin.latitude_deg,
            longitude_deg=origin.longitude_deg,
            altitude_amsl_m=origin.altitude_amsl_m,
        ),
        azimuth_deg=site.frame.azimuth_deg,
        wires=tuple((*item.position_m, 2.0 * item.radius_m) for item in site.conductors),
        points={
            target.name: target.view.aim_m for target in site.targets if target.view is not None
        },
    )


def picture_faults(folder: Path, site: Site, *, own: bool) -> list[str]:
    """Objections to the pictures of a flight, by what they truly show.

    Each view has its pictures; each that counts has its aim in its middle fifth and is sharp, or is
    marked. own: the camera is a real autopilot's, of whose pictures nothing is known.
    """
    rows = [row for row in _lines(folder / "inspection.jsonl") if row["kind"] == "picture"]
    true = {row["number"]: row["points"] for row in _lines(folder / FOLDER / "pictures.jsonl")}
    faults = []
    for target in site.targets:
        if target.view is None:
            continue
        counted = [row for row in rows if row.get("stop") == target.name and row["count"]]
        if len(counted) < target.view.pictures:
            faults.append(f"{target.name}: {len(counted)} of {target.view.pictures} pictures")
        for row in () if own else counted:
            objection = _objection(true.get(row["number"], {}).get(target.name))
            if objection and not row["marks"]:
                faults.append(f"{target.name}, picture {row['number']}: {objection}, not marked")
    return faults


def _objection(point: Mapping[str, float] | None) -> str:
    if point is None:
        return "the aim is not in it"
    right, down, blur_px = point["right"], point["down"], point["blur_px"]
    if max(abs(right), abs(down)) > _MIDDLE:
        return f"the aim is {right:+.2f}, {down:+.2f} of it off the middle"
    return "" if blur_px < 1.0 else f"blurred by {blur_px:.1f} pixels"


def _lines(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
