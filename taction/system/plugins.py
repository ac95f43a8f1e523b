"""What other installed packages add to taction, through entry points of Python.

A package names its objects in its ``pyproject.toml``::

    [project.entry-points."taction.opamps"]
    acme1 = "acme.opamps:ACME1"

The names come from the metadata of the installed packages, read once in a process; an object
is loaded when its name is asked for.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator, Mapping
from importlib import metadata, util
from importlib.metadata import EntryPoint
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar, cast

from taction.system.errors import Complaint, InputError

T = TypeVar("T")

GROUPS = tuple(
    f"taction.{name}"
    for name in ("amplifiers", "checks", "engines", "networks", "opamps", "topologies")
)
CODE = (".py", ".toml")  # suffixes of the files that can change a result


def distribution(offer: EntryPoint) -> str:
    """Return name and version of the package that makes an offer."""
    return "unknown" if offer.dist is None else f"{offer.dist.name} {offer.dist.version}"


def _refused(offer: EntryPoint, reason: str) -> InputError:
    complaint = Complaint(offer.group, repr(offer.name), reason)
    return InputError(f"plug-in {distribution(offer)}", complaint)


@functools.cache
def offers() -> tuple[EntryPoint, ...]:
    """Return what all installed packages offer, by group and name; InputError for a bad name."""
    every = metadata.entry_points()
    found = [offer for group in GROUPS for offer in every.select(group=group)]
    found.sort(key=lambda offer: (offer.group, offer.name, distribution(offer)))
    for before, offer in zip([None, *found], found, strict=False):
        if not re.fullmatch(r"[a-z][a-z0-9_]*", offer.name):
            text = "a name is a lower-case letter, then such letters, digits and '_'"
            raise _refused(offer, text)
        if before is not None and (before.group, before.name) == (offer.group, offer.name):
            text = f"the plug-in {distribution(before)} offers this name, too; uninstall one"
            raise _refused(offer, text)
    return tuple(found)


def names(group: str) -> tuple[str, ...]:
    """Return the names that installed packages offer in `group`; no object is loaded."""
    return tuple(offer.name for offer in offers() if offer.group == group)


class OpenTable(Mapping[str, T]):
    """A table of taction by name, to which installed packages add entries.

    `group`: one of `GROUPS`.
    `own`: the entries of taction itself, the first in every list.
    `kind`: class of every entry; with classes as entries, their base.
    `part`: attribute of a plug-in's object that is the entry; empty for the object itself.
    `optional`: an object without the part, or with None for it, has the entry None.
    InputError: when the table is read: a plug-in offers a name that is taken, an object that cannot
      be loaded, or one of another class. The message has package, group and name.
    """

    def __init__(
        self,
        group: str,
        own: Mapping[str, T] | Callable[[], Mapping[str, T]],
        kind: type[Any],
        part: str = "",
        *,
        optional: bool = False,
    ) -> None:
        self._group, self._own, self._kind = group, own, kind
        self._part, self._optional = part, optional

    def _entries(self) -> tuple[Mapping[str, T], Mapping[str, EntryPoint]]:
        """Return the own entries, and the offers of others, which are not loaded."""
        own = self._own() if callable(self._own) else self._own
        others = {offer.name: offer for offer in offers() if offer.group == self._group}
        if taken := own.keys() & others.keys():
            text = "taction itself has this name; take another one"
            raise _refused(others[min(taken)], text)
        return own, others

    def __iter__(self) -> Iterator[str]:
        return chain(*self._entries())

    def __len__(self) -> int:
        return sum(map(len, self._entries()))

    def __contains__(self, name: object) -> bool:
        return any(name in table for table in self._entries())

    def __getitem__(self, name: str) -> T:
        own, others = self._entries()
        return own[name] if name in own else cast(T, self._loaded(others[name]))

    def _loaded(self, offer: EntryPoint) -> Any:
        try:
            entry = offer.load()
        except Exception as error:  # whatever a module of another package raises
            text = f"{offer.value} cannot be loaded: {type(error).__name__}: {error}"
            raise _refused(offer, text) from error
        place = offer.value
        if self._part:
            place, entry = f"{place}.{self._part}", getattr(entry, self._part, None)
        fits = issubclass if isinstance(entry, type) else isinstance
        if not (fits(entry, self._kind) or (self._optional and entry is None)):
            found = entry.__name__ if isinstance(entry, type) else f"a {type(entry).__name__}"
            raise _refused(offer, f"{place} is {found}; expected {self._kind.__qualname__}")
        if getattr(entry, "name", offer.name) != offer.name:
            raise _refused(offer, f"{place} has the other name {entry.name!r}")
        return entry


def sources() -> Iterator[tuple[str, bytes]]:
    """Yield what can change a plug-in's results: versions, and files of its outermost package."""
    for offer in offers():
        yield f"{offer.group} {offer.name} {offer.value} {distribution(offer)}", b""
    for name in sorted({offer.module.partition(".")[0] for offer in offers()}):
        if (spec := util.find_spec(name)) is not None:
            folders = [Path(place) for place in spec.submodule_search_locations or ()]
            files = [file for folder in folders for file in folder.rglob("*")]
            for path in sorted(files or [Path(spec.origin or "")]):
                if path.suffix in CODE and path.is_file():
                    yield f"{name} {path.name}", path.read_bytes()
