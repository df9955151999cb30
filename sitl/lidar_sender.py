"""The packets of a lidar on an aircraft, by UDP."""

from sitl.lidar_carrier import LidarCarrier, Posed
from sitl.lidar_scene import PlacedScene
from sitl.ports import Datagrams


class LidarSender:
    """A carried lidar and its socket."""

    def __init__(self, scene: PlacedScene, host: str, port: int, *, seed: int = 1) -> None:
        """Resolve the host; OSError when it is unknown."""
        self._carrier = LidarCarrier(scene, seed)
        self._datagrams = Datagrams(host, port)

    def step(self, truth: Posed) -> None:
        """Send the packets that are complete at a truth's time."""
        for _, packet in self._carrier.step(truth):
            self._datagrams.send(packet)

    def close(self) -> None:
        """Close the socket."""
        self._datagrams.close()
