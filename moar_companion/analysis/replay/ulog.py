"""A PX4 ULog as a recording: topics and texts in the order of time, and the autopilot. No I/O.

The autopilot's own log contains the data of its MAVLink messages, at higher rates; `ulog_topics`
reads it. The companion's link to the autopilot is not in it.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence

from ...mavlink.identity import Autopilot, AutopilotFound
from ...mavlink.modes import is_multirotor
from ...mavlink.packet_count import SourceStatistics
from ...mavlink.passive_listener import Input, ListenerEvent, TextReceived, type_in_words
from ...mavlink.statustext import ReceivedText
from ...mavlink.telemetry import Telemetry
from ...texts.text_format import printable
from ...types import AutopilotKind
from .ulog_topics import ESTIMATOR, ESTIMATOR_SELECTOR, INPUT_OF, TOPICS, UlogSample, UlogTopic

_NO_ESTIMATOR = 255
"""primary_instance before one is selected."""
_SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")


def samples(
    topics: Sequence[UlogTopic], texts: Sequence[tuple[int, int, str]], begin_us: int
) -> Iterator[tuple[float, UlogSample]]:
    """Yields all samples in order, with times in seconds since boot. texts: time (us), level, text.

    Data published before the log began is present from its beginning. Topics without use for
    a companion are left out.
    """

    def rows(topic: UlogTopic) -> Iterator[tuple[int, int, UlogSample]]:
        for row, stamp_us in enumerate(topic.columns["timestamp"]):
            yield int(stamp_us), row, UlogSample(topic, row)

    def texts_by_time() -> Iterator[tuple[int, int, UlogSample]]:
        for number, (stamp_us, level, text) in enumerate(sorted(texts)):
            severity = _SEVERITIES[min(max(level, 0), len(_SEVERITIES) - 1)]
            yield (
                stamp_us,
                number,
                UlogSample(None, 0, ReceivedText(severity=severity, text=printable(text))),
            )

    sources = [rows(topic) for topic in topics if topic.name in TOPICS]
    for stamp_us, _, sample in heapq.merge(*sources, texts_by_time(), key=lambda item: item[:2]):
        yield max(stamp_us, begin_us) * 1e-6, sample


class UlogListener:
    """Reads a log's samples as the companion reads its autopilot, as `PassiveListener` does."""

    def __init__(self) -> None:
        self.telemetry = Telemetry()
        self.autopilot: AutopilotKind | None = None
        self.vehicle_type: str | None = None
        self.leans = True
        self.inputs = {name: Input() for name in dict.fromkeys(INPUT_OF.values())}
        self.sources: dict[tuple[int, int], SourceStatistics] = {}
        self._estimator = 0

    def tick(self, now_s: float) -> None:
        """Does nothing: a log has no packets to count."""

    def handle(self, sample: UlogSample, now_s: float) -> list[ListenerEvent]:
        """Takes a sample; returns the events in it."""
        if sample.text is not None:
            return [TextReceived(ours=False, text=sample.text)]
        assert sample.topic is not None
        name = sample.topic.name
        selected = sample.value("primary_instance") if name == ESTIMATOR_SELECTOR else None
        if selected is not None and selected != _NO_ESTIMATOR:
            self._estimator = int(selected)
        if name == ESTIMATOR and sample.topic.instance != self._estimator:
            return []
        before, known = self.telemetry, self.autopilot
        self.telemetry = TOPICS[name](before, sample, now_s)
        if self.telemetry is before:
            return []
        source = INPUT_OF[name]
        self.inputs[source] = Input(messages=self.inputs[source].messages + 1, last_s=now_s)
        status = self.telemetry.autopilot
        if status is None or status is before.autopilot:
            return []
        vehicle_type = sample.whole("system_type")
        self.vehicle_type = type_in_words(vehicle_type)
        self.leans = is_multirotor(vehicle_type)
        self.autopilot = status.kind
        if known is not None:
            return []
        found = Autopilot(
            system_id=status.system_id,
            component_id=status.component_id,
            kind=status.kind,
            link="log",
        )
        return [AutopilotFound(autopilot=found)]
