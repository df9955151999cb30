"""Pictures of a report: their times, thumbnails, and copies with place, direction and time in EXIF.

Pillow reads and writes them. The originals are never changed; the picture in a JPEG copy keeps the
original's quantization.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from PIL import ExifTags, Image, ImageOps, UnidentifiedImageError
from PIL.JpegImagePlugin import JpegImageFile

from ..analysis.inspection_report.picture_match import PictureFile, exif_time_s

SUFFIXES = frozenset({".jpg", ".jpeg", ".png"})
_THUMBNAIL_PX = (480, 360)
_QUALITY = 78
_UNREADABLE = (OSError, UnidentifiedImageError, ValueError, Image.DecompressionBombError)


def pictures_in(folder: Path) -> Iterator[PictureFile]:
    """The pictures of a folder and its subfolders, with their times; raises OSError."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in SUFFIXES and path.is_file():
            yield PictureFile(name=str(path.relative_to(folder)), taken_s=_taken_s(path))


def _taken_s(path: Path) -> float | None:
    try:
        with Image.open(path) as picture:
            details = picture.getexif().get_ifd(ExifTags.IFD.Exif)
    except _UNREADABLE:
        return None
    taken = str(details.get(ExifTags.Base.DateTimeOriginal, ""))
    return exif_time_s(taken, str(details.get(ExifTags.Base.SubsecTimeOriginal, "")))


def thumbnail_base64(path: Path) -> str | None:
    """A small JPEG, upright, in base64; None for a file that is no sound picture."""
    try:
        with Image.open(path) as picture:
            picture.draft("RGB", _THUMBNAIL_PX)
            small = _upright(picture).convert("RGB")
            small.thumbnail(_THUMBNAIL_PX)
            content = io.BytesIO()
            small.save(content, "JPEG", quality=_QUALITY)
    except _UNREADABLE:
        return None
    return base64.b64encode(content.getvalue()).decode()


def _upright(picture: Image.Image) -> Image.Image:
    try:
        return ImageOps.exif_transpose(picture)
    except Exception:  # noqa: BLE001 - Pillow raises many of EXIF that is odd
        return picture


def write_copy(path: Path, copy: Path, row: Mapping[str, Any]) -> bool:
    """Writes a copy with the row's place, direction and time; False for an unsound picture.

    EXIF that Pillow cannot write again is left out. Raises OSError where the copy cannot be
    written.
    """
    try:
        picture = Image.open(path)
        picture.load()
    except _UNREADABLE:
        return False
    with picture:
        if isinstance(picture, JpegImageFile):
            picture.format = "JPEG"  # also of an MPO, which has its preview as a second picture
        try:
            content = _content(picture, picture.getexif(), row)
        except Exception:  # noqa: BLE001 - Pillow raises many of EXIF that is odd
            content = _content(picture, Image.Exif(), row)
    copy.write_bytes(content)
    return True


def _content(picture: Image.Image, exif: Image.Exif, row: Mapping[str, Any]) -> bytes:
    """The file of a picture with this EXIF, and place, direction and time of the row."""
    _note(exif, row)
    keeps = {"quality": "keep"} if picture.format == "JPEG" else {}
    content = io.BytesIO()
    picture.save(content, format=picture.format, exif=exif, **keeps)
    return content.getvalue()


def _note(exif: Image.Exif, row: Mapping[str, Any]) -> None:
    """Writes GPS and time tags (EXIF 2.32); directions are from true north."""
    moment = datetime.fromtimestamp(row["time_s"], tz=timezone.utc)
    gps = ExifTags.GPS
    latitude_deg, longitude_deg = row["latitude_deg"], row["longitude_deg"]
    altitude_m = row["altitude_amsl_m"]
    place = exif.get_ifd(ExifTags.IFD.GPSInfo)
    place.update(
        {
            gps.GPSVersionID: b"\x02\x03\x00\x00",
            gps.GPSLatitudeRef: "N" if latitude_deg >= 0.0 else "S",
            gps.GPSLatitude: _degrees_minutes_seconds(latitude_deg),
            gps.GPSLongitudeRef: "E" if longitude_deg >= 0.0 else "W",
            gps.GPSLongitude: _degrees_minutes_seconds(longitude_deg),
            gps.GPSAltitudeRef: b"\x00" if altitude_m >= 0.0 else b"\x01",
            gps.GPSAltitude: abs(altitude_m),
            gps.GPSTimeStamp: (float(moment.hour), float(moment.minute), float(moment.second)),
            gps.GPSDateStamp: f"{moment:%Y:%m:%d}",
            gps.GPSMapDatum: "WGS-84",
        }
    )
    heading_deg = row.get("camera_heading_deg")
    if heading_deg is None:
        heading_deg = row.get("yaw_deg")
    if heading_deg is not None:
        place.update({gps.GPSImgDirectionRef: "T", gps.GPSImgDirection: float(heading_deg)})
    details = exif.get_ifd(ExifTags.IFD.Exif)
    details.setdefault(ExifTags.Base.DateTimeOriginal, f"{moment:%Y:%m:%d %H:%M:%S}")
    exif[ExifTags.Base.ImageDescription] = f"{row['target']}, view {row['view']}"


def _degrees_minutes_seconds(angle_deg: float) -> tuple[float, float, float]:
    minutes, degrees = math.modf(abs(angle_deg))
    seconds, whole = math.modf(minutes * 60.0)
    return degrees, whole, round(seconds * 60.0, 5)
