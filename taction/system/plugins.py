"""What other installed packages add to taction, through entry points of Python.

A package names its objects in its ``pyproject.toml``::

    [project.entry-points."taction.opamps"]
    acme1 = "acme.opamps:ACME1"

Nothing is looked for and nothing is loaded before a table is read: the names of a table come from
the metadata of the installed packages, an object from its module when its name is asked for.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

from taction.system.errors import Complaint, InputError

P = ParamSpec("P")
T = TypeVar("T")
C = TypeVar("C")

GROUPS = (
    "taction.amplifiers",
    "taction.checks",
    "taction.engines",
    "taction.networks",
    "taction.opamps",
    "taction.topologies",
)
CODE = (".py", ".toml")  # suffixes of the files that can change a result
_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True, order=True)
class Offer:
    """One object that an installed package offers, as its metadata say."""

    group: str  # one of `GROUPS`
    name: str
    value: str  # module:attribute
    distribution: str
    version: str

    def refused(self, reason: str) -> InputError:
        """Return the error that names the package, the group and the name."""
        complaint = Complaint(self.group, repr(self.name), reason)
        return InputError(f"plug-in {self.distribution} {self.version}", complaint)


_caches: list[Any] = []


def forgotten(cache: C) -> C:
    """Let `forget` clear a cache whose results depend on plug-ins."""
    _caches.append(cache)
    return cache


def cached(function: Callable[P, T]) -> Callable[P, T]:
    """Cache a function whose results depend on plug-ins, until `forget`."""
    return forgotten(functools.cache(function))  # type: ignore[return-value]


@cached
def offers() -> tuple[Offer, ...]:
    """Return what all installed packages offer; their metadata are read once.

    Raises
    ------
    InputError
        A name is offered twice, or is not made of lower-case letters, digits and '_'.
    """
    from importlib import metadata

    found: list[Offer] = []
    every = metadata.entry_points()
    for group in GROUPS:
        for entry in every.select(group=group):
            owner = entry.dist
            origin = ("unknown", "") if owner is None else (owner.name, owner.version)
            found.append(Offer(group, entry.name, entry.value, *origin))
    found.sort()
    for before, offer in zip([None, *found], found, strict=False):
        if not _NAME.fullmatch(offer.name):
            raise offer.refused("a name is a lower-case letter, then such letters, digits and '_'")
        if before is not None and (before.group, before.name) == (offer.group, offer.name):
            raise offer.refused(
                f"the plug-in {before.distribution} {before.version} offers this name, too;"
                " uninstall one of the two"
            )
    return tuple(found)


def forget() -> None:
    """Look for installed packages again, after one was installed while this process runs."""
    for cache in _caches:
        cache.cache_clear()


@cached
def _loaded(offer: Offer) -> Any:
    from importlib import metadata

    try:
        return metadata.EntryPoint(offer.name, offer.value, offer.group).load()
    except Exception as error:  # whatever a module of another package raises
        reason = f"{offer.value} cannot be loaded: {type(error).__name__}: {error}"
        raise offer.refused(reason) from error


def names(group: str) -> tuple[str, ...]:
    """Return the names that installed packages offer in `group`; no object is loaded."""
    return tuple(offer.name for offer in offers() if offer.group == group)


class Modules(Mapping[str, Any]):
    """The objects of one name in the modules of a package, which are loaded one by one.

    Examples
    --------
    >>> from taction.netlist_gen import topologies
    >>> Modules(topologies, "TOPOLOGY")["integrator"].name
    'integrator'
    """

    def __init__(self, package: ModuleType, attribute: str) -> None:
        self._package, self._attribute = package, attribute

    def __iter__(self) -> Iterator[str]:
        return iter(self._package.NAMES)

    def __len__(self) -> int:
        return len(self._package.NAMES)

    def __contains__(self, name: object) -> bool:
        return name in self._package.NAMES

    def __getitem__(self, name: str) -> Any:
        if name not in self._package.NAMES:
            raise KeyError(name)
        return getattr(import_module(f"{self._package.__name__}.{name}"), self._attribute)


class OpenTable(Mapping[str, T]):
    """A table of taction by name, to which installed packages add entries.

    Parameters
    ----------
    group : str
        One of `GROUPS`.
    own : mapping, or callable that returns one
        The entries of taction itself, the first in every list.
    kind : type
        Class of every entry; with classes as entries, their base.
    part : str
        Attribute of a plug-in's object that is the entry; empty for the object itself. Tables of
        several readers so take different parts of one object.
    optional : bool
        An object without the part, or with None for it, has the entry None.

    Raises
    ------
    InputError
        When the table is read: a plug-in offers a name that is taken, an object that cannot be
        loaded, or one of another class. The message has package, group and name.

    Examples
    --------
    >>> table = OpenTable("taction.opamps", {"one": 1}, int)
    >>> list(table), table["one"], "two" in table
    (['one'], 1, False)
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
        if group not in GROUPS:
            raise ValueError(f"group = {group!r}: expected one of {', '.join(GROUPS)}")
        self._group, self._own, self._kind = group, own, kind
        self._part, self._optional = part, optional

    def _ours(self) -> Mapping[str, T]:
        return self._own() if callable(self._own) else self._own

    def _offers(self) -> dict[str, Offer]:
        """Return the offers to this table by name; none has the name of an own entry."""
        added = {offer.name: offer for offer in offers() if offer.group == self._group}
        for name in added:
            if name in self._ours():
                raise added[name].refused("taction itself has this name; take another one")
        return added

    def __iter__(self) -> Iterator[str]:
        yield from (*self._ours(), *self._offers())

    def __len__(self) -> int:
        return len(self._ours()) + len(self._offers())

    def __contains__(self, name: object) -> bool:
        return name in self._offers() or name in self._ours()

    def __getitem__(self, name: str) -> T:
        added = self._offers()
        return self._checked(added[name]) if name in added else self._ours()[name]

    def _checked(self, offer: Offer) -> T:
        entry = _loaded(offer)
        place = f"{offer.value}.{self._part}" if self._part else offer.value
        if self._part:
            entry = getattr(entry, self._part, None)
        fits = issubclass if isinstance(entry, type) else isinstance
        if not (fits(entry, self._kind) or (self._optional and entry is None)):
            found = entry.__name__ if isinstance(entry, type) else f"a {type(entry).__name__}"
            raise offer.refused(f"{place} is {found}; expected {self._kind.__qualname__}")
        if getattr(entry, "name", offer.name) != offer.name:
            raise offer.refused(f"{place} has the other name {entry.name!r}")
        result: T = entry
        return result


def sources() -> Iterator[tuple[str, bytes]]:
    """Yield name and bytes of what can change a plug-in's results: its version and its files."""
    for offer in offers():
        yield repr(offer), b""
    for module in sorted({offer.value.partition(":")[0].strip() for offer in offers()}):
        for path, name in _files(module):
            yield name, path.read_bytes()


def _files(module: str) -> Iterable[tuple[Path, str]]:
    """Return the files of the outermost regular package or module that holds `module`."""
    from importlib.util import find_spec

    parts = module.split(".")
    for count in range(1, len(parts) + 1):
        name = ".".join(parts[:count])
        try:
            spec = find_spec(name)
        except Exception:  # a package around it fails; loading the entry says so
            return ()
        if spec is None:
            return ()
        if spec.origin is None or not spec.has_location:  # a namespace, which others share
            continue
        origin = Path(spec.origin)
        if not spec.submodule_search_locations:
            return ((origin, name),)
        folder = origin.parent
        files = sorted(file for file in folder.rglob("*") if file.suffix in CODE)
        return tuple((file, f"{name}/{file.relative_to(folder).as_posix()}") for file in files)
    return ()
