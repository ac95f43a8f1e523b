"""What must be the same where a study is asked for and where its points are computed."""

from __future__ import annotations

import functools
import platform
from dataclasses import dataclass
from importlib import metadata

from verification.engines.ngspice.executable import Simulator, find_simulator
from verification.studies.running.digests import own_code


class OtherVersionsError(Exception):
    """A worker has other versions than who asks; its result would be another one."""


@dataclass(frozen=True, slots=True)
class Versions:
    """What must be the same where points are asked for and where they are computed."""

    taction: str
    code: bytes
    ngspice: str

    def differences(self, other: Versions) -> list[str]:
        """Say in words how `other` differs; empty if it does not."""
        found = []
        if self.taction != other.taction:
            found.append(f"taction {other.taction} instead of {self.taction}")
        elif self.code != other.code:
            found.append(f"another state of the source of taction {self.taction}")
        if self.ngspice != other.ngspice:
            found.append(f"{other.ngspice or 'no ngspice'} instead of {self.ngspice}")
        return found

    def check_here(self) -> None:
        """Compare with the versions of this process.

        Raises
        ------
        OtherVersionsError
            They differ.
        """
        if found := self.differences(own_versions(bool(self.ngspice))):
            raise OtherVersionsError(f"{platform.node()} has {', '.join(found)}")


@functools.cache
def own_versions(ngspice: bool) -> Versions:
    """Return the versions of this process; without those of ngspice where it plays no part.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        No ngspice that will do.
    """
    name = simulator_name(find_simulator()) if ngspice else ""
    return Versions(metadata.version("taction"), own_code(), name)


def simulator_name(simulator: Simulator) -> str:
    """Name what of an ngspice can change a result: its version and its matrix solver."""
    return f"{simulator.engine} {simulator.solver_option}"
