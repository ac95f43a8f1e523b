"""What to buy better for a yield: parts with smaller tolerances, predicted and drawn again."""

from __future__ import annotations

from dataclasses import dataclass

TARGET = 0.99  # the yield that a remedy is looked for, and wanted from it


@dataclass(frozen=True, slots=True)
class Remedy:
    """Smaller tolerances, and the yield that they give.

    Attributes
    ----------
    parts : dict of str to float
        Tolerances of single parts, by name.
    kinds : dict of str to float
        Tolerances of every part of a kind.
    target, predicted : float
        The wanted yield, and the one that the sensitivities predict for all samples.
    samples, passed : int
        Samples that were drawn again with these tolerances, and how many of them pass.
    low, high : float
        95 % interval of the yield of these; 0 and 1 without any.
    """

    parts: dict[str, float]
    kinds: dict[str, float]
    target: float
    predicted: float
    samples: int = 0
    passed: int = 0
    low: float = 0.0
    high: float = 1.0

    @property
    def what(self) -> str:
        """The parts in words: ``"Rf_4_4 and Ra_4_in to 0.1 %"``; empty if there are none."""
        groups: dict[float, list[str]] = {}
        for kind, tolerance in self.kinds.items():
            groups.setdefault(tolerance, []).append(f"every {kind}")
        for name, tolerance in self.parts.items():
            groups.setdefault(tolerance, []).append(name)
        return " and ".join(
            f"{_listed(names)} to {100 * tolerance:.3g} %" for tolerance, names in groups.items()
        )

    @property
    def fraction(self) -> float:
        """The yield of the samples that were drawn again, else the predicted one."""
        return self.passed / self.samples if self.samples else self.predicted


def _listed(names: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
