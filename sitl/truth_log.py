"""The truth log: a CSV file of the true state, to judge a flight afterwards."""

import contextlib
from pathlib import Path
from typing import Final

from sitl.autopilot import Options, Truth

_COLUMNS: Final = (
    "time_s,north_m,east_m,down_m,vn_mps,ve_mps,vd_mps,roll_rad,pitch_rad,yaw_rad,"
    "wind_north_mps,wind_east_mps,wind_down_mps,latitude_deg,longitude_deg,altitude_amsl_m,"
    "battery_fraction,thrust,armed,mode,landed_state,on_ground"
)
PERIOD_S: Final = 0.05


class TruthLog:
    """Writes a row every 50 ms of simulated time; each row is flushed at once."""

    def __init__(self, path: Path, options: Options) -> None:
        """Create the file; OSError, with one line for the user, when that is impossible."""
        self._path = path
        self._next_s = 0.0
        try:
            self._file = path.open("w", encoding="utf-8", buffering=1)
        except OSError as error:
            raise self._named(error) from None
        self._write(
            f"# home latitude_deg={options.latitude_deg!r} longitude_deg={options.longitude_deg!r}"
            f" altitude_amsl_m={options.altitude_amsl_m!r} yaw_deg={options.yaw_deg!r};"
            " positions are metres north, east, down of home (WGS84)\n"
        )
        self._write(_COLUMNS + "\n")

    def step(self, truth: Truth) -> None:
        """Write a row if it is due; OSError as above when it cannot be written."""
        if truth.time_s + 1e-9 < self._next_s:
            return
        self._next_s += PERIOD_S
        if self._next_s <= truth.time_s:
            self._next_s = truth.time_s + PERIOD_S
        numbers = (
            *truth.position_ned_m, *truth.velocity_ned_mps, *truth.attitude_rad,
            *truth.wind_ned_mps,
        )  # fmt: skip
        self._write(
            f"{truth.time_s:.3f},"
            + ",".join(f"{number:.5f}" for number in numbers)
            + f",{truth.latitude_deg:.9f},{truth.longitude_deg:.9f},{truth.altitude_amsl_m:.4f}"
            f",{truth.battery_fraction:.5f},{truth.thrust:.4f},{int(truth.armed)},{truth.mode}"
            f",{truth.landed_state},{int(truth.on_ground)}\n"
        )

    def close(self) -> None:
        """Close the file; a write error was reported before."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _write(self, text: str) -> None:
        try:
            self._file.write(text)
        except OSError as error:
            self.close()
            raise self._named(error) from None

    def _named(self, error: OSError) -> OSError:
        return OSError(f"--truth {self._path}: {error.strerror or error}")
