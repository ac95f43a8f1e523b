"""Ideal networks of topologies that solve otherwise than by the gradient flow of eq (9).

A module has the name of its topology and an object `NETWORK`, which sees only problem and scene.
"""

from pkgutil import iter_modules

NAMES = tuple(module.name for module in iter_modules(__path__))
"""The topologies with a module here."""
