#!/usr/bin/env bash
# Run the numerical tests, and scenes/ against its baseline, with every set of BLAS kernels that
# this processor executes.
#
# processors.sh [KERNELS ...] [-- ARGUMENTS]    KERNELS are names of OpenBLAS, ARGUMENTS pytest's
#
# A name may stand for another one's kernels, so each set that is really loaded runs once, with one
# thread and with two.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

python=.venv/bin/python
rooms=(engines readings reference stability verdict test_coverage.py)
cores=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do cores+=("$1") && shift; done
shift || true
[ ${#cores[@]} -gt 0 ] || cores=(Prescott Core2 Nehalem Sandybridge Haswell Zen SkylakeX Cooperlake
    SapphireRapids ARMV8 NEOVERSEN1 NEOVERSEV1)

# The kernels that are loaded: a processor that lacks their instructions ends here, not in a test.
loaded() {
    "$python" - 2>/dev/null <<'EOF'
import numpy as np, scipy.linalg
from threadpoolctl import threadpool_info
a = np.random.default_rng(1).normal(size=(200, 200))
assert np.allclose(a @ np.linalg.inv(a), np.eye(200), atol=1e-8)
assert np.allclose(scipy.linalg.expm(0.01 * a) @ scipy.linalg.expm(-0.01 * a), np.eye(200))
print("+".join(sorted({i["architecture"] for i in threadpool_info() if "architecture" in i})))
EOF
}

status=0 seen=" "
for core in "${cores[@]}"; do
    export OPENBLAS_CORETYPE=$core
    kernels=$(loaded) || continue
    [[ "$seen" == *" $kernels "* ]] && continue
    seen+="$kernels "
    for threads in 1 2; do
        export OPENBLAS_NUM_THREADS=$threads OMP_NUM_THREADS=$threads
        say "$kernels kernels, threads: $threads"
        "$python" -m pytest "${rooms[@]/#/tests/verification/}" "$@" || status=1
        "$python" -m taction regress scenes/ --baseline scenes/baseline.json || status=1
    done
done
say "kernels:$seen"
[ "$seen" != " " ] && exit $status
