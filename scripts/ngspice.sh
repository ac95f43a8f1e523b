#!/usr/bin/env bash
# Give the machine an ngspice, 46 or newer with KLU where its packages have one: from the backports
# on Debian 12, from the distribution elsewhere. Never fails: without ngspice the rest works.
#
# ngspice.sh MARK [--again]    MARK remembers an attempt that did not reach KLU, so that the next
#                              run does not ask the network again unless told to.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

OLDEST=39
MARK=$1

# No `grep -q` and no `head` on a pipe: under pipefail a writer that they cut off reads as failure.
banner() { "${TACTION_NGSPICE:-ngspice}" -v 2>/dev/null </dev/null || true; }
version() { banner | sed -n 's/.*ngspice-\([0-9]*\).*/\1/p'; }
has_klu() { [[ "$(banner)" == *KLU* ]]; }
is_usable() { [ "$(version)" -ge $OLDEST ] 2>/dev/null; }

backports_known() { [[ "$(apt-cache madison ngspice 2>/dev/null)" == *" $1-backports/"* ]]; }

# The mirror is the machine's own: apt names the archive that Debian itself signed, and the new
# entry is a copy of the machine's entry for it, key and options included.
add_backports() {
    local codename=$1 uri entry
    # shellcheck disable=SC2016  # apt expands REPO_URI, not the shell
    uri=$(apt-get indextargets --format '$(REPO_URI)' \
        'Created-By: Packages' 'Origin: Debian' "Codename: $codename" 'Component: main')
    entry=$(as_root python3 scripts/backports.py "$codename" "${uri%%$'\n'*}") || return 1
    say "added $entry, for ngspice only (backports are never taken unasked)"
    apt_get update || true
    if ! backports_known "$codename"; then
        say "this mirror has no $codename-backports; removing $entry"
        as_root rm -f "$entry"
        apt_get update || true
        return 1
    fi
}

install_ngspice() {
    local codename
    # shellcheck source=/dev/null
    codename=$(. /etc/os-release 2>/dev/null && echo "${ID:-}-${VERSION_CODENAME:-}")
    apt_get update || true # a broken third-party source does no harm here
    if [ "$codename" = debian-bookworm ]; then
        if backports_known bookworm || add_backports bookworm; then
            apt_install -t bookworm-backports ngspice && return
        fi
    fi
    apt_install ngspice
}

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
    say "installing ngspice"
    install_ngspice || true
else
    say "no root, sudo or apt-get here: ngspice stays as it is"
fi
has_klu || touch "$MARK"
report
