"""The document of a site file as text, in the layout of the shipped sites."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import yaml


def site_text(document: Mapping[str, Any], remarks: Iterable[str]) -> str:
    """YAML of a site, its remarks as comments at the head."""
    lines = [f"# {remark}" for remark in remarks]
    for key, value in document.items():
        if isinstance(value, list):
            lines += ["", f"{key}:", *(f"  - {_flow(item)}" for item in value)]
        elif key in ("frame", "targets", "landing"):
            lines += ["", f"{key}:", *(f"  {_flow(name)}: {_flow(each)}" for name, each in value.items())]
        else:
            lines += ["", f"{key}: {_flow(value)}"] if lines else [f"{key}: {_flow(value)}"]
    return "\n".join(lines) + "\n"


def _flow(value: object) -> str:
    text = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=1_000_000, allow_unicode=True
    )
    return str(text).removesuffix("\n").removesuffix("...").strip()
