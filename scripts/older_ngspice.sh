#!/usr/bin/env bash
# Put the ngspice 39 of Debian 12 beside the installed one, into .ngspice-39, and print its
# path; print nothing where the distribution's packages have no ngspice 39. Nothing is installed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

FOLDER=$PWD/.ngspice-39
EXECUTABLE=$FOLDER/usr/bin/ngspice

starts() { [[ "$("$EXECUTABLE" -v 2>/dev/null </dev/null)" == *ngspice-39* ]]; }

download() {
    local release work
    command -v apt-get >/dev/null && command -v dpkg-deb >/dev/null || return 1
    # No `grep -q` and no `head`: under pipefail a writer that they cut off reads as failure.
    release=$(apt-cache madison ngspice 2>/dev/null | sed -n 's/^ *ngspice |  *\(39[^ ]*\) .*/\1/p')
    release=${release%%$'\n'*}
    [ -n "$release" ] || return 1
    work=$(mktemp -d)
    if (cd "$work" && apt-get -q download "ngspice=$release") >"$work/log" 2>&1; then
        rm -rf "$FOLDER"
        dpkg-deb -x "$work"/ngspice_*.deb "$FOLDER"
    else
        tail -n 3 "$work/log" >&2
    fi
    rm -rf "$work"
}

starts || download || true
if starts; then
    printf '%s\n' "$EXECUTABLE"
else
    say "no ngspice 39 here: the packages of this distribution have none, or its libraries are missing"
fi
