#!/usr/bin/env bash
# Print the path of a kicad-cli, 8 or newer, for the tests of schematics; install KiCad where it is
# missing and may be installed: from the backports on Debian 12. Exit status 1: there is none.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/backports.sh
source scripts/backports.sh

find_kicad() {
    local path major
    path=$(command -v "${TACTION_KICAD:-kicad-cli}") || return 1
    major=$("$path" version 2>/dev/null </dev/null | sed -n 's/^\([0-9]*\)\..*/\1/p')
    [ "${major:-0}" -ge 8 ] && printf '%s\n' "$path"
}

find_kicad && exit
if may_install; then
    say "installing KiCad (57 MB; without its libraries)"
    install_newest kicad || true
fi
find_kicad && exit
say "no KiCad 8 or newer here, and it may not be installed; as root: apt-get install kicad"
say "or name one: make test-kicad TACTION_KICAD=/path/to/kicad-cli"
exit 1
