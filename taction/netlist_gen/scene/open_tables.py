"""What installed packages add: op-amps and amplifiers, names of choices, and tables of keys.

An object in ``taction.checks`` or ``taction.topologies`` may have an attribute `keys`, a `Model`:
the table ``[checks.NAME]``, or ``[design.NAME]`` for the topology NAME.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any, TypeVar

from pydantic import ValidationError, create_model

from taction.netlist_gen import topologies
from taction.netlist_gen.scene.fields import Checked, Model
from taction.spice_models.amplifier import KINDS, AmplifierKind
from taction.spice_models.opamp import OpAmp
from taction.spice_models.presets import load_presets
from taction.system.errors import Complaint, InputError, listed, nearest_question
from taction.system.plugins import OpenTable, names

M = TypeVar("M", bound=Model)

OPAMPS: Mapping[str, OpAmp] = OpenTable("taction.opamps", load_presets, OpAmp)
"""The op-amps by name: the presets, then those of other packages."""

AMPLIFIERS: Mapping[str, AmplifierKind] = OpenTable(
    "taction.amplifiers", KINDS, AmplifierKind, part="deck"
)
"""The kinds of signal amplifier by name, with those of other packages (`Amplifier`)."""


class OneOf(Checked):
    """Annotation of a name out of `known`, or out of a `group` of plug-ins; read at each use."""

    def __init__(self, known: Iterable[str], group: str = "") -> None:
        self.known, self.group = known, group

    @property
    def names(self) -> tuple[str, ...]:
        """The names that are accepted now."""
        return (*self.known, *(names(self.group) if self.group else ()))

    def check(self, value: object) -> str:
        """Return the name; ValueError has the nearest one and all others."""
        accepted = self.names
        if isinstance(value, str):
            if value in accepted:
                return value
            raise ValueError(f"{nearest_question(value, accepted)}one of {listed(accepted)}")
        raise ValueError(f"expected a name, one of {listed(accepted)}")

    def described(self) -> dict[str, Any]:
        """Return the schema of the names."""
        return {"enum": list(self.names), "type": "string"}


NAMES = {
    "op-amp": OneOf(OPAMPS),
    "amplifier": OneOf(AMPLIFIERS),
    "topology": OneOf(topologies.NAMES, "taction.topologies"),
    "engine": OneOf(("auto", "ngspice", "statespace"), "taction.engines"),
}
"""What a scene names, and the names that it may give."""


def with_tables(base: type[M], group: str, module: str) -> type[M]:
    """Return `base` with a table for each plug-in of `group` that has keys, if any."""
    offered: OpenTable[type[Model] | None] = OpenTable(group, {}, Model, "keys", optional=True)
    fields: dict[str, Any] = {}
    for name, keys in offered.items():
        if keys is not None:
            default: Model | None = None
            if group != "taction.checks":
                with suppress(ValidationError):  # it has a key that the scene must give
                    default = keys()
            fields[name] = (keys | None, default)
    return plugged(base, module, fields) if fields else base


def plugged(base: type[M], module: str, fields: dict[str, Any]) -> type[M]:
    """Return the subclass of `base` with more fields that pickle finds in `module`."""
    made: type[M] = create_model(
        base.__name__, __base__=base, __module__=module, __doc__=base.__doc__, **fields
    )
    made.__qualname__ = f"Plugged{base.__name__}"
    return made


def models() -> dict[str, OpAmp]:
    """List the op-amp presets; `show NAME` has one with all figures, measured beside stated.

    Returns
    -------
    dict of str to OpAmp
        The presets by name.

    Examples
    --------
    >>> import taction
    >>> taction.models()["tl084"].slew_rate
    13000000.0
    """
    return dict(OPAMPS)


def refuse_unknown(opamp: str, option: str) -> None:
    """Refuse an op-amp that is no preset, with the nearest one and all of them."""
    if opamp not in OPAMPS:
        hint = nearest_question(opamp, tuple(OPAMPS), 0.6)
        text = f"no preset; {hint}known: {', '.join(OPAMPS)}"
        raise InputError(option, Complaint("NAME", repr(opamp), text))
