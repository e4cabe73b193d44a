"""Values that are given for LETs of a job outside of its text (-D NAME=VALUE)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

Overrides = Mapping[str, str]
"""By name the value that its first LET sets, as the right side of a LET: "60%"."""
NO_OVERRIDES: Overrides = MappingProxyType({})


def overrides_text(overrides: Overrides) -> str:
    """Return 'dose=60%, pitch=0.5mm', '' for none."""
    return ", ".join(f"{name}={value}" for name, value in overrides.items())
