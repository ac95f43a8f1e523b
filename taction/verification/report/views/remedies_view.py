"""The changes that mend a failed verdict, as text and as plain data."""

from __future__ import annotations

from collections.abc import Iterator

from taction.netlist_gen.scene.keys import SYMBOLS, Value, find_key
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import show
from taction.verification.design.remedies import Change, Remedies
from taction.verification.design.stable_ranges import StableRange
from taction.verification.report.texts import spaced

NAMES = {path: symbol for symbol, path in SYMBOLS.items()} | {"design.gain": "gain"}


def remedies_text(scene: Scene, remedies: Remedies) -> str:
    """Return the changes as lines of text.

    Examples
    --------
    >>> import taction
    >>> from taction.verification.design.remedies import find_remedies
    >>> from taction.netlist_gen.scene.axes import with_value
    >>> scene = taction.load_scene("scenes/tuned-breadboard.toml")
    >>> slow = with_value(scene, "design.capacitance", 1e-10)
    >>> verdict = taction.verify(slow, engine="statespace")
    >>> print(remedies_text(slow, find_remedies(verdict)).splitlines()[1])
      C = 77.3 pF (verified)
    """
    return "\n".join(_lines(scene, remedies))


HEAD = "what to change (by the state-space engine; lambda stays unless it is named):"


def _lines(scene: Scene, remedies: Remedies) -> Iterator[str]:
    yield HEAD
    if remedies.unmendable:
        names = ", ".join(map(spaced, remedies.unmendable))
        yield f"  no change of the design mends: {names}"
        return
    edges = [text for each in remedies.stability if (text := edge_text(each))]
    if edges:
        yield f"  stable {', or '.join(edges)}"
    if remedies.opamps:
        yield f"  {'or' if edges else 'stable'} with {' or '.join(remedies.opamps)}"
    for change in remedies.changes:
        yield f"  {_change(scene, change)}"
    for searched in remedies.without:
        where = ""
        if searched.least is not None and searched.most is not None:
            unit = find_key(scene, searched.paths[0]).unit
            where = f" from {show(searched.least, unit, 3)} to {show(searched.most, unit, 3)}"
        names = " and ".join(map(name_of, searched.paths))
        yield f"  no tried value of {names}{where} makes the board pass"
    keys = ", ".join(map(name_of, remedies.searched)) or "no key"
    cut = [" and ".join(map(name_of, paths)) for paths in remedies.cut]
    rest = f"; not to the end: {', '.join(cut)} (--changes)" if cut else ""
    yield f"  searched {remedies.trials} changes of {keys}{rest}"
    if remedies.undecided:
        count = len(remedies.undecided)
        yield f"  {count} of them without a verdict, such as: {remedies.undecided[0]}"


def edge_text(found: StableRange) -> str:
    """Return the nearest edge of a stable range: ``"from C = 9.023 pF"``; empty without one."""
    name = name_of(found.path)
    if found.edge is None:
        return ""
    side = "from" if found.edge == found.low else "up to"
    text = f"{side} {name} = {show(found.edge, found.unit)}"
    other = found.high if found.edge == found.low else found.low
    if other is not None:
        text += f" ({'to' if found.edge == found.low else 'from'} {show(other, found.unit)})"
    return text


def distance_text(found: StableRange) -> str:
    """Return how far a board is from stability on one key."""
    name, own = name_of(found.path), show(found.own, found.unit)
    if found.reason:
        return f"{name} = {own}: not known, {found.reason}"
    if found.edge is None or found.factor is None:
        ends = f"{show(found.least, found.unit)} to {show(found.most, found.unit)}"
        return f"{name} = {own}: no value from {ends} makes the board stable"
    return f"{name} = {own}: stable {edge_text(found)}, {found.factor:.4g} times the scene's value"


def _change(scene: Scene, change: Change) -> str:
    values = {path: v for path, v in change.values.items() if path != "design.lambda"}
    if not values:
        values = change.values
    text = " and ".join(key_with_value(scene, path, value) for path, value in values.items())
    if change.resistance is not None:
        text += f" with R = {show(change.resistance, 'ohm')}"
    if change.left:
        mended = ", ".join(map(spaced, change.mends))
        return f"{text}: mends {mended}, but not {', '.join(map(spaced, change.left))}"
    return f"{text} (verified)"


def key_with_value(scene: Scene, path: str, value: Value) -> str:
    """Return ``"C = 9.76 pF"``."""
    if isinstance(value, float):
        value = show(value, find_key(scene, path).unit)
    return f"{name_of(path)} = {value}"


def name_of(path: str) -> str:
    """Return the symbol of a key, or the last part of its path."""
    return NAMES.get(path, path.removeprefix("design.").removeprefix("opamp."))
