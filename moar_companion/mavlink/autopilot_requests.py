"""Requests of data from the autopilot, and their answers. No I/O.

Requested are the heartbeat of a received autopilot, message rates, the local origin and home,
parameters, the uploaded fence and the version. TIMESYNC measures the delay of the link. None of
them moves the aircraft: that is `autopilot_control`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping

from . import fence_download, translate_outgoing
from .autopilots import profile
from .autopilots.parameter_names import Parameters
from .autopilots.profile import Profile
from .dialect import Message, create, mavlink
from .fence_download import FenceDownload
from .identity import Autopilot
from .message_rates import MessageRates, on_line, on_network, wanted_rates_hz
from .outbox import Outbox
from .parameters import ParameterRequests
from .telemetry import FenceItem, Telemetry
from .telemetry_receiver import TelemetryReceiver
from .urls import line_bytes_per_s

_TIMESYNC = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
_TIMESYNC_PERIOD_S = 0.125
_TIMESYNC_ANSWERS = 2
"""Answers of which the shortest counts: one may be late for the autopilot's own delay."""
_TIMESYNC_LOST_S = 3.0
"""Time for 24 requests: on a link that loses 30 % each way, one of them is answered except for one
time in 10^7."""
_TIMESYNC_WAITING = 480
"""Requests that may still be answered: one minute of them."""


class TimesyncRtt:
    """Sends periodic TIMESYNC requests and keeps the round-trip times of the last answers.

    An answer waits in the same queues as telemetry, so that it shows a link that falls behind. The
    autopilot's clock has no influence: a simulator's may run at any speed.
    Source: https://mavlink.io/en/services/timesync.html.
    """

    def __init__(self) -> None:
        self._asked_s: deque[tuple[int, float]] = deque(maxlen=_TIMESYNC_WAITING)
        """ts1 and time of the open requests."""
        self._last_s: deque[float] = deque(maxlen=_TIMESYNC_ANSWERS)
        self.shortest_s = math.inf
        """Shortest round trip so far."""
        self._due_s = -math.inf

    def least_s(self, now_s: float) -> float | None:
        """Shorter of the last two round trips; None before two answers.

        A request unanswered for 3 s or more counts with its waiting time.
        """
        if len(self._last_s) < _TIMESYNC_ANSWERS:
            return None
        least_s = min(self._last_s)
        waited_s = now_s - self._asked_s[0][1] if self._asked_s else 0.0
        return max(least_s, waited_s) if waited_s >= _TIMESYNC_LOST_S else least_s

    def next_request(self, target: tuple[int, int], now_s: float) -> Message | None:
        """Request that is due now, to this system and component; None if none is due."""
        if now_s < self._due_s:
            return None
        self._due_s = now_s + _TIMESYNC_PERIOD_S
        stamp = max(1, int(now_s * 1e9))
        self._asked_s.append((stamp, now_s))
        return create(
            "TIMESYNC", tc1=0, ts1=stamp, target_system=target[0], target_component=target[1]
        )

    def handle(self, message: Message, now_s: float) -> None:
        """Takes a message of the autopilot; answers arrive in the order of their requests."""
        if message.get_msgId() != _TIMESYNC or message.tc1 == 0:
            return
        asked_s = next((time_s for stamp, time_s in self._asked_s if stamp == message.ts1), None)
        if asked_s is None:
            return
        while self._asked_s and self._asked_s[0][1] <= asked_s:
            self._asked_s.popleft()
        self._last_s.append(now_s - asked_s)
        self.shortest_s = min(self.shortest_s, now_s - asked_s)


_ORIGIN = int(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
_HOME = int(mavlink.MAVLINK_MSG_ID_HOME_POSITION)

_ORIGIN_PERIOD_S = 5.0
"""Period of origin requests: estimators may move it in flight; PX4 reports it unasked only once."""
_UNKNOWN_PERIOD_S = 2.0
"""Period of requests of an origin or a home that the autopilot has not reported."""


class OriginHomeRequests:
    """Requests the origin continuously, and home until it is known; from the first call on."""

    def __init__(self) -> None:
        self._origin_requested_s = -math.inf
        self._home_requested_s = -math.inf

    def next_request(self, telemetry: Telemetry, now_s: float) -> int | None:
        """Message to request now with MAV_CMD_REQUEST_MESSAGE; at most one per call."""
        origin = telemetry.local_origin
        if origin is None:
            origin_due_s = self._origin_requested_s + _UNKNOWN_PERIOD_S
        else:
            origin_due_s = max(self._origin_requested_s, origin.received_s) + _ORIGIN_PERIOD_S
        if now_s >= origin_due_s:
            self._origin_requested_s = now_s
            return _ORIGIN
        if telemetry.home is None and now_s >= self._home_requested_s + _UNKNOWN_PERIOD_S:
            self._home_requested_s = now_s
            return _HOME
        return None


_SET_MESSAGE_INTERVAL = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
_REQUEST_MESSAGE = int(mavlink.MAV_CMD_REQUEST_MESSAGE)
_AUTOPILOT_VERSION = int(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
_PARAM_VALUE = int(mavlink.MAVLINK_MSG_ID_PARAM_VALUE)
_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_HEARTBEAT_PERIOD_S = 1.0
_VERSION_PERIOD_S = 1.0
_MOST_VERSION_REQUESTS = 10
"""Both autopilots answer the first that arrives."""

MESSAGE_IDS: frozenset[int] = fence_download.MESSAGE_IDS | {_PARAM_VALUE}
"""Messages that are read as answers alone, not as telemetry."""


class AutopilotRequests:
    """Requests of the one autopilot, from its first heartbeat on, and again after its restart.

    rates_hz: wanted rates by message id; None: those of its kind. obstacles: True if the distances
    of obstacles that it reports are wanted, too. signed: links on which all packets are signed.
    """

    def __init__(
        self,
        receiver: TelemetryReceiver,
        outbox: Outbox,
        rates_hz: Mapping[int, float] | None,
        *,
        obstacles: bool = False,
        signed: Collection[str] = (),
    ) -> None:
        self._receiver = receiver
        self._outbox = outbox
        self._rates_hz = rates_hz
        self._obstacles = obstacles
        self._signed = frozenset(signed)
        self._rates = MessageRates()
        self._more_hz: dict[int, float] = {}
        """Wanted rates beside those of every flight, by message id."""
        self._places = OriginHomeRequests()
        self._parameters = ParameterRequests()
        self._fence: FenceDownload | None = None
        self._round_trips = TimesyncRtt()
        self._identify_s = self._version_s = -math.inf
        self._version_requests = 0
        self._link: str | None = None
        """Link for which the rates were started."""
        self.unidentified: tuple[str, tuple[int, int]] | None = None
        """Link and ids of a received autopilot without a heartbeat so far."""

    @property
    def parameters(self) -> Parameters:
        """Parameters requested by `want_parameters`, by key; None: never reported."""
        return self._parameters.values

    @property
    def fence_items(self) -> tuple[FenceItem, ...] | None:
        """Fence that was uploaded to the autopilot, once `want_fence` was called.

        None while unknown; empty without a fence.
        """
        return None if self._fence is None else self._fence.items

    @property
    def fence_silent(self) -> bool:
        """True while the autopilot does not answer requests of its uploaded fence."""
        return self._fence is not None and self._fence.silent

    def want_parameters(self, keys: Collection[str], *, changing: bool = False) -> None:
        """Adds parameters to request, and again after the autopilot's restart.

        changing: requests them periodically, for parameters that may change in flight.
        """
        self._parameters.want(keys, changing=changing)

    def want_messages(self, rates_hz: Mapping[int, float], now_s: float) -> None:
        """Adds messages of a payload that the autopilot manages, by message id."""
        for message_id in rates_hz.keys() - self._more_hz.keys():
            self._more_hz[message_id] = rates_hz[message_id]
            self._rates.add(message_id, rates_hz[message_id], now_s)

    def want_fence(self) -> None:
        """Starts the periodic download of the uploaded fence."""
        self._fence = self._fence or FenceDownload()

    def want_all_of(self, known: Profile) -> None:
        """Adds what a flight needs of a found autopilot: parameters and fence (as `check` does)."""
        self.want_parameters(known.loss_parameters)
        self.want_parameters(known.fence_parameters, changing=True)
        self.want_fence()
        self.want_parameters(known.failsafe_parameters)
        self.want_parameters(known.holding_parameters)

    def start(self, autopilot: Autopilot, now_s: float) -> None:
        """Starts the requests of a found or restarted autopilot, with a heartbeat first."""
        self._start_rates(autopilot, now_s)
        self._places = OriginHomeRequests()
        self._round_trips = TimesyncRtt()
        self._parameters.start(profile(autopilot.kind), now_s)
        self._version_s, self._version_requests = -math.inf, 0
        if self._fence is not None:
            self._fence.restart()
        self._outbox.make_heartbeat_due(now_s)

    def _start_rates(self, autopilot: Autopilot, now_s: float) -> None:
        self._link = autopilot.link
        known = profile(autopilot.kind)
        wanted_hz = wanted_rates_hz(autopilot.kind) if self._rates_hz is None else self._rates_hz
        wanted_hz = {**wanted_hz, **self._more_hz}
        line = line_bytes_per_s(autopilot.link)
        if line is None:
            rates_hz = on_network(wanted_hz, obstacles=self._obstacles)
        else:
            signed = autopilot.link in self._signed
            rates_hz = on_line(wanted_hz, known.line_share * line, signed=signed)
        self._rates.start(
            rates_hz,
            silent=not known.streams_by_itself,
            slow_line=line is not None and rates_hz != wanted_hz,
            now_s=now_s,
        )

    # In

    def handle(
        self, message: Message, autopilot: Autopilot, ours: tuple[int, int], now_s: float
    ) -> None:
        """Takes a message of the autopilot on its link. ours: the companion's ids."""
        message_id = message.get_msgId()
        self._rates.count(message_id)
        self._round_trips.handle(message, now_s)
        if message_id == _PARAM_VALUE:
            self._parameters.handle(message, autopilot.kind)
        elif message_id in fence_download.MESSAGE_IDS:
            self._handle_fence(message, autopilot, ours, now_s)

    def _handle_fence(
        self, message: Message, autopilot: Autopilot, ours: tuple[int, int], now_s: float
    ) -> None:
        if self._fence is None or (message.target_system, message.target_component) != ours:
            return
        end = self._fence.handle(message, autopilot.ids, now_s)
        if end is not None:
            self._outbox.send(autopilot.link, end)

    def count_unused(self, message_id: int, link: str, now_s: float) -> None:
        """Counts an unread message of the autopilot on its link."""
        self._rates.count_unused(message_id, link, now_s)

    def answered(self, message: Message) -> None:
        """Takes a COMMAND_ACK of the autopilot, addressed to the companion or to all."""
        if message.command == _SET_MESSAGE_INTERVAL:
            self._rates.answered(message.result)

    def round_trips_s(self, now_s: float) -> tuple[float | None, float]:
        """Shorter of the last two round trips, None before two; the shortest of all."""
        return self._round_trips.least_s(now_s), self._round_trips.shortest_s

    # Out

    def identify(self, now_s: float) -> None:
        """Requests the heartbeat of a received autopilot: the next may be 1 s away."""
        if self.unidentified is None or now_s < self._identify_s + _HEARTBEAT_PERIOD_S:
            return
        self._identify_s = now_s
        link, target = self.unidentified
        request = translate_outgoing.command_message(
            target=target, command=_REQUEST_MESSAGE, parameters=(_HEARTBEAT,)
        )
        self._outbox.send(link, request)

    def send_due(self, autopilot: Autopilot, now_s: float, *, others: bool) -> None:
        """Queues all due requests. others: True if its link ever carried another sender.

        A serial port has one reader, the companion: the autopilot forwards other senders there from
        links with their own streams.
        """
        link, target, telemetry = autopilot.link, autopilot.ids, self._receiver.telemetry
        if link != self._link:
            # The autopilot is received on another link: its streams there have rates of their own.
            self._start_rates(autopilot, now_s)
        question = self._round_trips.next_request(target, now_s)
        if question is not None:
            self._outbox.send(link, question)
        shared = others and not _on_serial_port(autopilot)
        rate = self._rates.next_request(now_s, link, shared=shared)
        if rate is not None:
            self._outbox.send_command(autopilot, _SET_MESSAGE_INTERVAL, *rate)
        place = self._places.next_request(telemetry, now_s)
        if place is not None:
            self._outbox.send_command(autopilot, _REQUEST_MESSAGE, place)
        self._send_version_request(autopilot, now_s)
        known = profile(autopilot.kind)
        if telemetry.firmware is not None:
            self._parameters.learn_release(telemetry.firmware.version)
        if telemetry.second_gnss is not None:
            self._parameters.want(known.gnss_parameters)
        if telemetry.motors is not None:
            self._parameters.want(known.motor_range or ())
        for name in self._parameters.requests(now_s):
            request = translate_outgoing.parameter_request_message(target=target, name=name)
            self._outbox.send(link, request)
        if self._fence is not None:
            asked = self._fence.next_request(target, now_s)
            if asked is not None:
                self._outbox.send(link, asked)

    def _send_version_request(self, autopilot: Autopilot, now_s: float) -> None:
        """Requests AUTOPILOT_VERSION until it arrives: the names of parameters depend on it."""
        if (
            self._receiver.telemetry.firmware is None
            and self._version_requests < _MOST_VERSION_REQUESTS
            and now_s >= self._version_s + _VERSION_PERIOD_S
        ):
            self._version_s = now_s
            self._version_requests += 1
            self._outbox.send_command(autopilot, _REQUEST_MESSAGE, _AUTOPILOT_VERSION)


def _on_serial_port(autopilot: Autopilot) -> bool:
    return autopilot.link.startswith("serial:")
