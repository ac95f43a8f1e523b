"""The signs for ohm and micro, for pages and pictures; a terminal shows plain letters."""

from __future__ import annotations

import re

OHM = re.compile(r"ohm\b")
MICRO = re.compile(r"(?<=\d )u(?=[A-Za-zΩ/])|(?<=V/)u(?=s\b)")


def readable(text: str) -> str:
    """Return `text` with the signs for ohm and micro."""
    return MICRO.sub("µ", OHM.sub("Ω", text))
