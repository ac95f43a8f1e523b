#!/usr/bin/env bash
# Give the machine an ngspice, 46 or newer with KLU where its packages have one: from the backports
# on Debian 12, from the distribution elsewhere. Never fails: without ngspice the rest works.
#
# ngspice.sh MARK [--again]    MARK remembers an attempt that did not reach KLU, so that the next
#                              run does not ask the network again unless told to.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/backports.sh
source scripts/backports.sh

OLDEST=39
MARK=$1

# No `grep -q` and no `head` on a pipe: under pipefail a writer that they cut off reads as failure.
banner() { "${TACTION_NGSPICE:-ngspice}" -v 2>/dev/null </dev/null || true; }
version() { banner | sed -n 's/.*ngspice-\([0-9]*\).*/\1/p'; }
has_klu() { [[ "$(banner)" == *KLU* ]]; }
is_usable() { [ "$(version)" -ge $OLDEST ] 2>/dev/null; }

report() {
    if has_klu; then
        say "ngspice $(version) with KLU"
    elif is_usable; then
        say "ngspice $(version), without KLU: everything works, boards above 30 channels take 2 to 5 times longer"
    else
        say "ngspice $OLDEST or newer is missing: no ngspice simulation, and its tests are skipped (in CI they fail)."
        say "what works: netlists, reference solutions, and verification by the state-space engine."
        say "to install it, as root: apt-get install ngspice; then make setup"
    fi
}

has_klu && exit 0
if [ -e "$MARK" ] && [ "${2:-}" != --again ]; then
    is_usable || report
    exit 0
fi
if may_install; then
    say "step 3 of 3: installing ngspice"
    install_newest ngspice || true
else
    say "no root, sudo or apt-get here: ngspice stays as it is"
fi
has_klu || touch "$MARK"
report
