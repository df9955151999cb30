"""The camera: found on the autopilot's system, pictures taken and confirmed. No I/O.

A camera is a component of its own (ids 100 to 105), or the autopilot: ArduPilot answers for its
cameras as one, PX4's camera trigger answers MAV_CMD_DO_DIGICAM_CONTROL alone. A picture counts when
CAMERA_IMAGE_CAPTURED, or ArduPilot's CAMERA_FEEDBACK, confirms it. Where that was lost it is
requested again by its number. Then the picture is taken again: a repeated command has the same
sequence number, by which a camera recognises it.

Source: https://mavlink.io/en/services/camera.html; AP_Camera (4.6), PX4's camera_trigger and
camera_feedback (v1.17).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from ..texts import pilot_texts
from .commands import CommandResult, result_words
from .dialect import Message, mavlink
from .sent_command import SentCommand

_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_COMMAND_ACK = int(mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
_INFORMATION = int(mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION)
_CAPTURE_STATUS = int(mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS)
_IMAGE_CAPTURED = int(mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED)
_FEEDBACK = int(mavlink.MAVLINK_MSG_ID_CAMERA_FEEDBACK)
MESSAGE_IDS = frozenset({_INFORMATION, _CAPTURE_STATUS, _IMAGE_CAPTURED, _FEEDBACK})
"""Messages that are read of cameras alone."""

CAMERA_IDS = range(mavlink.MAV_COMP_ID_CAMERA, mavlink.MAV_COMP_ID_CAMERA6 + 1)
_REQUEST_MESSAGE = int(mavlink.MAV_CMD_REQUEST_MESSAGE)
_START_CAPTURE = int(mavlink.MAV_CMD_IMAGE_START_CAPTURE)
_DIGICAM = int(mavlink.MAV_CMD_DO_DIGICAM_CONTROL)
_START_VIDEO = int(mavlink.MAV_CMD_VIDEO_START_CAPTURE)
_STOP_VIDEO = int(mavlink.MAV_CMD_VIDEO_STOP_CAPTURE)
_SET_ZOOM = int(mavlink.MAV_CMD_SET_CAMERA_ZOOM)
_ZOOM_RANGE = float(mavlink.ZOOM_TYPE_RANGE)

_HEARTBEATS_S = 2.5
"""Wait for a camera's heartbeat at 1 Hz, of which one may be lost; then the autopilot is asked."""
_CONFIRM_S = 2.0
"""Wait for the confirmation of an accepted picture: a camera stores it meanwhile."""
_ASKS = 3
"""Requests of a lost confirmation."""
_ASK_PERIOD_S = 0.7
_TRIES = 3
"""Pictures that are taken for one that is confirmed."""
_VIDEO_S = 15.0
"""Longest wait for the start of a video."""
_LAST_UTC_US = 4_102_444_800_000_000
"""The year 2100: a greater `time_utc` is no time, or in another unit."""
_BUSY_PERIOD_S = 1.0
_REFUSED_S = {CommandResult.TEMPORARILY_REJECTED: 15.0, CommandResult.FAILED: 5.0}
"""Longest wait for a camera that refuses a picture and may take it a moment later: a slow card
takes seconds for a burst. ArduPilot's camera fails while the servo still presses the shutter, and
within `CAM1_INTRVAL_MIN`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A camera that was found. field_of_view_rad: horizontal and vertical; None where unknown."""

    link: str
    ids: tuple[int, int]
    name: str
    field_of_view_rad: tuple[float, float] | None
    by_digicam: bool = False
    """True for an autopilot that reports no camera: it may answer DO_DIGICAM_CONTROL."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Image:
    """A confirmed picture. number: of the camera; file: its name or URL, empty where not told.

    utc_s: seconds since 1970 by the camera; None where not told.
    """

    received_s: float
    number: int
    file: str = ""
    utc_s: float | None = None


class Capture(enum.Enum):
    """Progress of the picture or the video that was asked for last."""

    NONE = "none"
    PENDING = "pending"
    DONE = "done"
    """The picture is confirmed; the video runs."""
    FAILED = "failed"


class _Picture:
    """The picture that was asked for."""

    def __init__(self, command: SentCommand) -> None:
        self.command = command
        self.tries = 1
        self.asks = 0
        self.ask_s = math.inf
        self.refused_s: float | None = None


class CameraClient:
    """Finds the camera once it is wanted, and takes pictures and video with it."""

    def __init__(self) -> None:
        self.camera: Camera | None = None
        """The camera that is used; None while none is known."""
        self.picture = Capture.NONE
        self.video = Capture.NONE
        self.failure = ""
        """Reason of the last failure."""
        self.images: list[Image] = []
        """Confirmed pictures since the last `take_images`, those that others took included."""
        self._wanted_s: float | None = None
        self._heard: dict[int, str] = {}
        """Links of the cameras that were received, by component id."""
        self._asked: SentCommand | None = None
        self._searches = 0
        self._is_guess = False
        """True where the camera has not told what it is: only a picture will show."""
        self._sequence = 0
        self._last_number: int | None = None
        """Number of the last confirmed picture, or before it of the last on the card; -1: none.

        None while unknown.
        """
        self._full = False
        self._request: _Picture | None = None
        self._commands: list[SentCommand] = []
        """Open commands beside that of the picture: video, zoom, requests of messages."""
        self._video: SentCommand | None = None

    def want(self, now_s: float) -> None:
        """Starts the search for a camera, where none has told what it is."""
        idle = self._request is None and self.video is Capture.NONE
        late = self._is_guess and self._on_autopilot and bool(self._heard) and idle
        if self._wanted_s is None or late:
            self._wanted_s, self._asked, self._searches = now_s, None, 0
            self.camera, self._is_guess = None, False

    def take_images(self) -> list[Image]:
        """Confirmed pictures since the last call."""
        images, self.images = self.images, []
        return images

    # Orders

    def take_picture(self) -> None:
        """Takes one picture; `picture` is then its progress."""
        self._sequence += 1
        self._full = False
        self.picture = Capture.PENDING
        self._request = _Picture(self._picture_command())

    def forget_picture(self) -> None:
        """Gives the picture up that is awaited; a late confirmation is still read."""
        self._request, self.picture = None, Capture.NONE

    def start_video(self) -> None:
        """Starts a video; `video` is then its progress."""
        assert self.camera is not None
        self.video = Capture.PENDING
        self._video = SentCommand(self.camera.ids, _START_VIDEO, 0.0, 0.0)

    def stop_video(self) -> None:
        """Stops the video that runs or starts; repeated until it is acknowledged."""
        if self.camera is None or self.video is Capture.NONE:
            return
        self._video, self.video = None, Capture.NONE
        self._commands.append(SentCommand(self.camera.ids, _STOP_VIDEO, 0.0))

    def set_zoom(self, percent: float) -> None:
        """Sets the zoom, 0 to 100 % of the camera's range."""
        assert self.camera is not None
        self._commands.append(SentCommand(self.camera.ids, _SET_ZOOM, _ZOOM_RANGE, percent))

    # In

    def handle(self, message: Message, link: str, ours: tuple[int, int], now_s: float) -> None:
        """Takes a message of any component of the autopilot's system."""
        message_id, component = message.get_msgId(), message.get_srcComponent()
        source = (message.get_srcSystem(), component)
        if message_id == _HEARTBEAT:
            if component in CAMERA_IDS:
                self._heard[component] = link
            return
        if message_id == _INFORMATION and self._asked is not None and self.camera is None:
            if source == self._asked.target:
                self.camera = _camera(message, link, source)
                self._commands.append(self._message_request(_CAPTURE_STATUS))
            return
        if message_id == _COMMAND_ACK:
            self._take_answer(message, ours, now_s)
        elif self.camera is None or source != self.camera.ids:
            return
        elif message_id == _CAPTURE_STATUS:
            self._full = message.available_capacity <= 0.0  # NaN: not told
            # While a picture is taken, the count may have it already.
            if self._last_number is None and self._request is None:
                self._last_number = message.image_count - 1
        elif message_id == _IMAGE_CAPTURED:
            self._take_captured(message, now_s)
        elif message_id == _FEEDBACK:
            self._take_image(Image(received_s=now_s, number=message.img_idx))

    def _take_answer(self, message: Message, ours: tuple[int, int], now_s: float) -> None:
        if self._asked is not None and self._asked.answered(message, ours, now_s):
            return
        request = self._request
        if request is not None and request.command.answered(message, ours, now_s):
            return
        if self._video is not None and self._video.answered(message, ours, now_s):
            result = self._video.result
            if result is CommandResult.ACCEPTED:
                self.video = Capture.DONE
            elif result is not CommandResult.IN_PROGRESS:
                assert result is not None
                self.failure = pilot_texts.VIDEO_REFUSED(result=result_words(result))
                self.video = Capture.FAILED
            return
        for command in self._commands:
            if command.answered(message, ours, now_s):
                break
        self._commands = [command for command in self._commands if command.result is None]

    def _take_captured(self, message: Message, now_s: float) -> None:
        number = message.image_index
        if message.capture_result == 0:
            request = self._request
            if request is not None and request.command.result is not None:
                self._try_again(request)
            return
        utc_s = message.time_utc / 1e6 if 0 < message.time_utc < _LAST_UTC_US else None
        url = message.file_url
        self._take_image(Image(received_s=now_s, number=number, file=url, utc_s=utc_s))

    def _take_image(self, image: Image) -> None:
        if image.number == self._last_number:
            return  # a copy, or an answer to a request of a confirmation that came late
        self._last_number = image.number
        self.images.append(image)
        if self._request is not None:
            self._request, self.picture = None, Capture.DONE

    # Out

    def due(
        self, autopilot: tuple[str, tuple[int, int]], now_s: float
    ) -> Iterable[tuple[str, Message]]:
        """Packets that are due now, each with its link. autopilot: its link and ids."""
        if self._wanted_s is None:
            return []
        if self.camera is None:
            return self._search(autopilot, now_s)
        messages = self._picture_due(now_s)
        if self._video is not None:
            messages += self._video.due(now_s)
            since_s = now_s if self._video.first_s is None else self._video.first_s
            silent = self._video.unanswered(now_s) or now_s >= since_s + _VIDEO_S
            if self.video is Capture.PENDING and silent:
                self.video, self.failure = Capture.FAILED, pilot_texts.CAMERA_SILENT()
        self._commands = [item for item in self._commands if not item.unanswered(now_s)]
        for command in self._commands:
            messages += command.due(now_s)
        return [(self.camera.link, message) for message in messages]

    def _search(
        self, autopilot: tuple[str, tuple[int, int]], now_s: float
    ) -> list[tuple[str, Message]]:
        """Asks the camera with the lowest id, or the autopilot, for its information."""
        assert self._wanted_s is not None
        link, ids = autopilot
        if self._heard:
            component, link = min(self._heard.items())
            ids = (ids[0], component)
        elif now_s < self._wanted_s + _HEARTBEATS_S:
            return []
        if self._asked is None or self._asked.target != ids:
            self._asked, self._searches = self._information_request(ids), 1
        asked = self._asked
        # A denial may be that of another message: the autopilot answers alike to all requests.
        answered = asked.result not in {None, CommandResult.IN_PROGRESS}
        late = answered and now_s >= asked.answered_s + _ASK_PERIOD_S
        if late and asked.result is CommandResult.ACCEPTED and self._searches < _ASKS:
            self._asked, self._searches = self._information_request(ids), self._searches + 1
        elif late or asked.unanswered(now_s):
            self._is_guess = True
            of_autopilot = ids == autopilot[1]
            name = "camera trigger" if of_autopilot else f"camera {ids[1]}"
            self.camera = Camera(
                link=link, ids=ids, name=name, field_of_view_rad=None, by_digicam=of_autopilot
            )
        return [(link, message) for message in self._asked.due(now_s)]

    def _information_request(self, ids: tuple[int, int]) -> SentCommand:
        return SentCommand(ids, _REQUEST_MESSAGE, float(_INFORMATION))

    def _picture_due(self, now_s: float) -> list[Message]:
        request = self._request
        if request is None:
            return []
        command = request.command
        match command.result:
            case None:
                if command.unanswered(now_s):
                    self._without_answer(request)
            case CommandResult.ACCEPTED | CommandResult.IN_PROGRESS:
                return self._confirmation_due(request, now_s)
            case CommandResult.UNSUPPORTED if self._may_use_digicam:
                self._use_digicam(request)
            case refusal:
                self._refuse(request, refusal, now_s)
        return [] if self._request is None else self._request.command.due(now_s)

    def _confirmation_due(self, request: _Picture, now_s: float) -> list[Message]:
        """Requests a lost confirmation, then takes the picture again."""
        if request.ask_s == math.inf:
            request.ask_s = request.command.answered_s + _CONFIRM_S
        if now_s < request.ask_s:
            return []
        if request.asks == _ASKS:
            self._try_again(request)
            return []
        request.asks += 1
        request.ask_s = now_s + _ASK_PERIOD_S
        # ArduPilot resends its last CAMERA_FEEDBACK; a camera the picture of this number.
        asked = _FEEDBACK if self._on_autopilot and request.asks % 2 else _IMAGE_CAPTURED
        if asked == _FEEDBACK:
            return self._message_request(asked, most=1).due(now_s)
        if self._last_number is None:
            return []  # any number might be that of an older picture
        return self._message_request(asked, self._last_number + 1, most=1).due(now_s)

    def _try_again(self, request: _Picture) -> None:
        if request.tries == _TRIES:
            self._fail(pilot_texts.PICTURE_UNCONFIRMED())
            return
        self._sequence += 1
        request.tries += 1
        request.asks, request.ask_s = 0, math.inf
        request.command = self._picture_command()

    def _without_answer(self, request: _Picture) -> None:
        if self._may_use_digicam and request.command.command == _START_CAPTURE:
            self._use_digicam(request)
        else:
            self._fail(pilot_texts.CAMERA_SILENT())

    def _refuse(self, request: _Picture, result: CommandResult, now_s: float) -> None:
        """Asks whether the card is full, and tries again for a time, before the refusal counts."""
        if request.refused_s is None:
            request.refused_s = now_s
            self._commands.append(self._message_request(_CAPTURE_STATUS, most=2))
        if self._full:
            self._fail(pilot_texts.CARD_FULL())
        elif now_s >= request.refused_s + _REFUSED_S.get(result, _CONFIRM_S):
            self._fail(pilot_texts.PICTURE_REFUSED(result=result_words(result)))
        elif result in _REFUSED_S and now_s >= request.command.answered_s + _BUSY_PERIOD_S:
            request.command = self._picture_command()

    def _fail(self, reason: str) -> None:
        self._request, self.picture, self.failure = None, Capture.FAILED, reason

    # Commands

    @property
    def _on_autopilot(self) -> bool:
        return self.camera is not None and self.camera.ids[1] not in CAMERA_IDS

    @property
    def _uses_digicam(self) -> bool:
        return self.camera is not None and self.camera.by_digicam

    @property
    def _may_use_digicam(self) -> bool:
        return self._on_autopilot and not self._uses_digicam

    def _use_digicam(self, request: _Picture) -> None:
        """Goes over to DO_DIGICAM_CONTROL, for this picture and later ones."""
        assert self.camera is not None
        self.camera = replace(self.camera, by_digicam=True)
        request.command = self._picture_command()

    def _picture_command(self) -> SentCommand:
        assert self.camera is not None
        if self.camera.by_digicam:
            return SentCommand(self.camera.ids, _DIGICAM, 0.0, 0.0, 0.0, 0.0, 1.0, most=2)
        most = 2 if self._may_use_digicam else 4
        sequence = float(self._sequence)
        return SentCommand(self.camera.ids, _START_CAPTURE, 0.0, 0.0, 1.0, sequence, most=most)

    def _message_request(self, message_id: int, number: int = 0, most: int = 3) -> SentCommand:
        assert self.camera is not None
        return SentCommand(
            self.camera.ids, _REQUEST_MESSAGE, float(message_id), float(number), most=most
        )


def _camera(message: Message, link: str, ids: tuple[int, int]) -> Camera:
    names = (_text(message.vendor_name), _text(message.model_name))
    return Camera(
        link=link,
        ids=ids,
        name=" ".join(filter(None, names)) or f"camera {ids[1]}",
        field_of_view_rad=_field_of_view_rad(message),
    )


def _text(characters: Iterable[int]) -> str:
    """Text of an array of characters, up to the first 0."""
    text = bytes(characters).split(b"\0", 1)[0].decode("ascii", errors="replace")
    return "".join(char if char.isprintable() else "?" for char in text)


def _field_of_view_rad(message: Message) -> tuple[float, float] | None:
    """Angles of the picture's width and height; None where the lens or the sensor is not told."""
    focal_mm, sizes_mm = message.focal_length, (message.sensor_size_h, message.sensor_size_v)
    if not all(math.isfinite(value) and value > 0.0 for value in (focal_mm, *sizes_mm)):
        return None
    width, height = (2.0 * math.atan(size_mm / (2.0 * focal_mm)) for size_mm in sizes_mm)
    return width, height
