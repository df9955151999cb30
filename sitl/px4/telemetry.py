"""PX4's telemetry: one builder per message, from the vehicle's state to a payload."""

from sitl.builders import Builder
from sitl.px4.builders import Sources
from sitl.px4.telemetry_motion import MotionMessages
from sitl.px4.telemetry_status import StatusMessages
from sitl.wire import Layout, layout


class Telemetry:
    """All builders of one vehicle, and the messages' layouts, by message name."""

    def __init__(self, sources: Sources) -> None:
        """Prepare the builders."""
        self._motion = MotionMessages(sources)
        self.builders: dict[str, Builder] = {
            **self._motion.table(),
            **StatusMessages(sources).table(),
        }
        self.layouts: dict[str, Layout] = {name: layout(name) for name in self.builders}

    def step(self, dt: float) -> None:
        """Advance the parts that have a memory."""
        self._motion.step(dt)
