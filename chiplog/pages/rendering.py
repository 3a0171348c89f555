"""Templates to pages: escaped by default, and a name that is not there is an error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def render(template: str, context: Mapping[str, Any]) -> str:
    """Return the page of `template` (a file of `templates/`) filled with `context`."""
    environment = Environment(
        loader=PackageLoader("chiplog.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(context)
