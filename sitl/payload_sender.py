"""Camera and gimbal on an aircraft, by UDP, and the pictures as they truly are, as files.

They send to the companion's port from a port of their own, with the aircraft's system id, and take
what the companion sends there.

    FOLDER/pictures.jsonl    for each picture its number, time, and each point of the scene in it
    FOLDER/IMG_0000.JPG      small drawings, made when the flight has ended
"""

import contextlib
import json
import socket
from dataclasses import asdict
from pathlib import Path

import numpy as np
from PIL import Image

from sitl.payload import Moving, Payload, PayloadOptions, Picture
from sitl.picture import drawing


class PayloadSender:
    """A payload and its socket."""

    _address: tuple[str | int, ...] | tuple[int, bytes]

    def __init__(self, options: PayloadOptions, host: str, port: int, folder: Path) -> None:
        """Resolve the host, make the folder; OSError when that is impossible."""
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        family, kind, protocol, _, self._address = found
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file = (folder / "pictures.jsonl").open("w", encoding="utf-8", buffering=1)
        self._payload = Payload(options)
        self._written = 0
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)

    def step(self, truth: Moving) -> None:
        """Take what has arrived, and send what is due at a true state."""
        with contextlib.suppress(OSError):
            while True:
                self._payload.receive(self._socket.recv(65536))
        for data in self._payload.step(truth):
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._address)
        for picture in self._payload.pictures[self._written :]:
            self._written += 1
            self._file.write(json.dumps(_row(picture)) + "\n")

    def close(self) -> None:
        """Draw the pictures, and close."""
        self._socket.close()
        self._file.close()
        options = self._payload.options
        for picture in self._payload.pictures:
            image = drawing(options.scene, picture.pose, options.lens)
            pixels = np.round(255.0 * np.clip(image, 0.0, 1.0)).astype(np.uint8)
            name = self._folder / f"IMG_{picture.number:04d}.JPG"
            with contextlib.suppress(OSError):
                Image.fromarray(pixels).save(name, quality=90)


def _row(picture: Picture) -> dict[str, object]:
    sightings = {name: asdict(sighting) for name, sighting in picture.sightings.items()}
    return {"number": picture.number, "time_s": picture.time_s, "points": sightings}
