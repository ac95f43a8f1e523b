"""Run the numerical tests with every set of BLAS kernels that this processor executes.

OpenBLAS takes the kernels of the processor that `OPENBLAS_CORETYPE` names, where it has them; a
name may stand for another one's kernels, so each set that is really loaded runs once.

    python scripts/processors.py [--kernels NAME ...] [--threads N ...] [--scenes] [--others]
        [-- ARGUMENTS OF PYTEST]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time

CORES = ("Prescott", "Core2", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX")
CORES += ("Cooperlake", "SapphireRapids", "ARMV8", "NEOVERSEN1", "NEOVERSEV1")
ROOM = "tests/verification/"
TESTS = ("engines", "readings", "reference", "stability", "verdict", "test_rounding.py")
REGRESS = "from taction.cli.main import main; main()"
# The kernels' own work, too: a processor that lacks their instructions ends here, not in a test.
PROBE = """
import numpy as np, scipy.linalg
from threadpoolctl import threadpool_info
a = np.random.default_rng(1).normal(size=(200, 200))
assert np.allclose(a @ np.linalg.inv(a), np.eye(200), atol=1e-8)
assert np.allclose(scipy.linalg.expm(0.01 * a) @ scipy.linalg.expm(-0.01 * a), np.eye(200))
print(" and ".join(sorted({i["architecture"] for i in threadpool_info() if "architecture" in i})))
"""


def environment(core: str | None, threads: int) -> dict[str, str]:
    """Return the environment in which `core` is asked for (None: what it is)."""
    own = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), str(threads))
    return os.environ | own | ({} if core is None else {"OPENBLAS_CORETYPE": core})


def loaded(core: str | None) -> str:
    """Return the kernels that are loaded where `core` is asked for, or nothing if they fail."""
    run = subprocess.run(
        [sys.executable, "-c", PROBE], env=environment(core, 1), capture_output=True, text=True
    )
    return run.stdout.strip() if run.returncode == 0 else ""


def main() -> int:
    """Run everything; 1 if anything failed, or if nothing ran."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kernels", nargs="+", default=CORES, metavar="NAME")
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2], metavar="N")
    parser.add_argument("--tests", nargs="+", default=TESTS, metavar="ROOM", help=f"of {ROOM}")
    parser.add_argument("--others", action="store_true", help="leave out the kernels in use")
    parser.add_argument("--scenes", action="store_true", help="compare scenes/ with its baseline")
    parser.add_argument("pytest", nargs="*", help="arguments of pytest, behind --")
    asked = parser.parse_args()
    # A name that OpenBLAS does not know loads the processor's own kernels: the first name counts.
    sets: dict[str, str] = {}
    for core in asked.kernels:
        sets.setdefault(loaded(core), core)
    for left_out in ("", loaded(None) if asked.others else ""):
        sets.pop(left_out, None)
    commands = [["-m", "pytest", *(ROOM + test for test in asked.tests), *asked.pytest]]
    if asked.scenes:
        compare = ["regress", "scenes/", "--baseline", "scenes/baseline.json"]
        commands.append(["-c", REGRESS, *compare])
    failed = []
    for kernels, core in sets.items():
        for threads in asked.threads:
            began, name = time.monotonic(), f"{kernels} kernels, threads: {threads}"
            print(f"== {name} (OPENBLAS_CORETYPE={core})", flush=True)
            for command in commands:
                run = subprocess.run([sys.executable, *command], env=environment(core, threads))
                failed += [name] * (run.returncode != 0)
            print(f"== {name}: {time.monotonic() - began:.0f} s", flush=True)
    print(f"{len(sets)} sets of kernels; failed: {', '.join(dict.fromkeys(failed)) or 'none'}")
    return int(bool(failed) or not sets)


if __name__ == "__main__":
    sys.exit(main())
