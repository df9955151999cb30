"""JSON schemas of the payloads, shipped beside this file: `python -m moar_companion.mqtt.schemas`.

`NAME.json` is the schema of the topic NAME, with `_` for `/`.
"""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel

from ..payloads import Online, Order, Reply
from ..topics import ONLINE, ORDER, REPLY, TOPICS

FOLDER = Path(__file__).parent
_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schemas() -> dict[str, str]:
    """The text of each file by its name."""
    models: dict[str, type[BaseModel]] = {topic.name: topic.payload for topic in TOPICS}
    models |= {ONLINE: Online, ORDER: Order, REPLY: Reply}
    return {f"{name.replace('/', '_')}.json": _text(model) for name, model in models.items()}


def _text(model: type[BaseModel]) -> str:
    schema = {"$schema": _DIALECT, **model.model_json_schema(mode="serialization")}
    return json.dumps(schema, indent=1) + "\n"
