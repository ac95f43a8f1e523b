"""An independent bench of a vendor's op-amp: its text as it is, in a deck of its own.

The loop is closed at DC by a large coil and opened for small signals by a large capacitor; ngspice
runs alone, with its own compatibility to PSpice. Nothing of taction is used.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np

DECK = """* bench
.include vendor.lib
Vp vcc 0 {supply}
Vm vee 0 {minus}
Vin inp 0 dc 0 ac 1
Xone inp inn vcc vee out {name}
Lloop out inn 1e9
Chold inn 0 1e9
.options reltol=1e-6
.control
set numdgt=14
ac dec 200 1e-2 1e9
wrdata found.txt v(out) v(inn)
.endc
.end
"""


def gain_bandwidth_margin(
    folder: Path, text: str, name: str, supply: float
) -> tuple[float, float, float]:
    """Return the gain at 10 mHz, the frequency of unity gain, Hz, and its margin, degrees."""
    folder.mkdir()
    (folder / "vendor.lib").write_text(text.replace("\x1a", "").replace(name, "device"))
    (folder / "bench.cir").write_text(DECK.format(supply=supply, minus=-supply, name="device"))
    (folder / ".spiceinit").write_text("set ngbehavior=psa\n")
    subprocess.run(["ngspice", "-b", "bench.cir"], cwd=folder, capture_output=True, check=False)
    f, _, *parts = np.loadtxt(folder / "found.txt")[:, [0, 0, 1, 2, 4, 5]].T
    gain = (parts[0] + 1j * parts[1]) / (1.0 - parts[2] - 1j * parts[3])
    size, phase = np.log(np.abs(gain)), np.unwrap(np.angle(gain))
    unity = np.exp(np.interp(0.0, -size, np.log(f)))  # the gain falls everywhere
    return (
        abs(gain[0]),
        float(unity),
        180.0 + np.degrees(np.interp(np.log(unity), np.log(f), phase)),
    )
