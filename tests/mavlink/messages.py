"""Messages by name with a few fields given, and telemetry updated with them."""

from __future__ import annotations

from moar_companion.mavlink import translate
from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.mavlink.telemetry import Telemetry


def message_of(name, **fields):
    """A message with these fields and zeros elsewhere."""
    message_class = next(c for c in mavlink.mavlink_map.values() if c.msgname == name)
    given_fields = {}
    for field, type_name in zip(message_class.fieldnames, message_class.fieldtypes, strict=True):
        order = message_class.ordered_fieldnames.index(field)
        length = message_class.array_lengths[order]
        zero = 0.0 if type_name in ("float", "double") else 0
        given_fields[field] = [zero] * length if length else zero
    return create(name, **{**given_fields, **fields})


def updated(name, telemetry=None, now_s=10.0, **fields):
    return translate.update(telemetry or Telemetry(), message_of(name, **fields), now_s)
