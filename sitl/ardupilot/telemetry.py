"""ArduPilot's telemetry: one builder per message, from the vehicle's state to a payload."""

from sitl.ardupilot.receiver import Receiver
from sitl.ardupilot.state import State
from sitl.ardupilot.telemetry_motion import MotionMessages
from sitl.ardupilot.telemetry_status import StatusMessages
from sitl.builders import Builder
from sitl.parameters import Parameters
from sitl.world import World


class Telemetry:
    """All builders of one vehicle, by message name."""

    def __init__(self, world: World, state: State, parameters: Parameters, boot_us: int) -> None:
        """Prepare the builders."""
        self._receiver = Receiver(world, boot_us, parameters.value("SIM_BOOT_S"))
        self._motion = MotionMessages(world, state, self._receiver, boot_us)
        self._status = StatusMessages(world, state, parameters, self._motion, boot_us)
        self._builders: dict[str, Builder] = {**self._motion.table(), **self._status.table()}

    def step(self, dt_s: float) -> None:
        """Advance the parts that have a memory."""
        self._receiver.step()
        self._motion.step()
        self._status.step(dt_s)

    def build(self, name: str) -> bytes | None:
        """Return a payload; None when there is no such message or no such data now."""
        builder = self._builders.get(name)
        return None if builder is None else builder()
