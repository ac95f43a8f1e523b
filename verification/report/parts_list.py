"""The parts of a board as a table, as CSV with KiCad's columns, and as JSON."""

from __future__ import annotations


# The fields of KiCad's bill of materials, then our own; a footprint is not known.
