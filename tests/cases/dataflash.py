"""Small ArduPilot logs, made of the messages of a release with their layouts."""

from __future__ import annotations

import struct

from pymavlink.DFReader import FORMAT_TO_STRUCT

_FMT = 128
_LAYOUTS = {"FMT": (_FMT, "BBnNZ", "Type,Length,Name,Format,Columns")}


class DataflashLog:
    """Bytes of a .bin: every message is defined before it is written."""

    def __init__(self, layouts):
        """layouts: format characters and columns by the message's name."""
        self._layouts = dict(_LAYOUTS)
        self._data = bytearray()
        for number, (name, (layout, columns)) in enumerate(layouts.items(), start=129):
            self._layouts[name] = (number, layout, columns)
        for name, (number, layout, columns) in self._layouts.items():
            size = 3 + struct.calcsize(_packed(layout))
            self.put("FMT", number, size, name.encode(), layout.encode(), columns.encode())

    def put(self, name, *values):
        """Writes a message, with the values as they are stored."""
        number, layout, _ = self._layouts[name]
        self._data += struct.pack("<BBB", 0xA3, 0x95, number)
        self._data += struct.pack(_packed(layout), *values)

    def save(self, path):
        """Writes the file; returns its path."""
        path.write_bytes(bytes(self._data))
        return path


def _packed(layout):
    return "<" + "".join(FORMAT_TO_STRUCT[letter][0] for letter in layout)
