"""Topologies: one module each says how a scene becomes a board, and what this board is."""

from pkgutil import iter_modules

NAMES = tuple(module.name for module in iter_modules(__path__) if not module.ispkg)
"""The topologies of taction: the modules of this folder."""
