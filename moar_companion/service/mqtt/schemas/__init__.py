"""JSON schemas of the payloads, shipped beside this file.

`moar-companion docs` writes them.

`NAME.json` is the schema of the topic NAME, with `_` for `/`.
"""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import ModelSchema

from ..payloads import Online, OrderPayload, Reply
from ..topics import ONLINE, ORDER, REPLY, TOPICS

FOLDER = Path(__file__).parent
_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_SUFFIX = "Payload"
"""Ending of models whose names other classes have; the schemas do not show it."""


class _PublishedNames(GenerateJsonSchema):
    """Schemas with the models' names without the ending, in titles and in `$defs`."""

    def normalize_name(self, name: str) -> str:
        return super().normalize_name(name).removesuffix(_SUFFIX)

    def model_schema(self, schema: ModelSchema) -> JsonSchemaValue:
        shown = super().model_schema(schema)
        return {**shown, "title": shown["title"].removesuffix(_SUFFIX)}


def schemas() -> dict[str, str]:
    """The text of each file by its name."""
    models: dict[str, type[BaseModel]] = {topic.name: topic.payload for topic in TOPICS}
    models |= {ONLINE: Online, ORDER: OrderPayload, REPLY: Reply}
    return {f"{name.replace('/', '_')}.json": _text(model) for name, model in models.items()}


def _text(model: type[BaseModel]) -> str:
    schema = model.model_json_schema(mode="serialization", schema_generator=_PublishedNames)
    return json.dumps({"$schema": _DIALECT, **schema}, indent=1) + "\n"
