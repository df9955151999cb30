"""JSON schemas of the payloads, shipped beside this file.

`moar-companion docs` writes them.

`NAME.json` is the schema of the topic NAME, with `_` for `/`.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from ..payloads import Online, OrderPayload, Reply
from ..topics import ONLINE, ORDER, REPLY, TOPICS

FOLDER = Path(__file__).parent
_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_ENDING = re.compile(r'(?<=[/"])([A-Z]\w+?)(?:Payload|Section|Entry)"')
"""A class's name in titles and in `$defs`, with an ending that the schemas do not show."""


def schemas() -> dict[str, str]:
    """The text of each file by its name."""
    kinds: dict[str, Any] = {topic.name: topic.payload for topic in TOPICS}
    kinds |= {ONLINE: Online, ORDER: OrderPayload, REPLY: Reply}
    return {f"{name.replace('/', '_')}.json": _text(kind) for name, kind in kinds.items()}


def _text(kind: Any) -> str:
    schema = TypeAdapter(kind).json_schema(mode="serialization")
    return _ENDING.sub(r'\1"', json.dumps({"$schema": _DIALECT, **schema}, indent=1)) + "\n"
