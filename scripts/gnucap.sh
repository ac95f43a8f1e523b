#!/usr/bin/env bash
# Give the machine gnucap, the simulator beside ngspice that reads decks of other dialects in tests.
# Never fails: without it these tests are skipped (in CI they fail).
#
# gnucap.sh MARK    MARK remembers an attempt that failed, so that the next run does not ask the
#                   network again; `make clean` removes it with .venv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Debian's gnucap only recommends its plug-ins, without which it reads none of the tests' decks.
PLUGINS=gnucap-default-plugins0
is_complete() {
    command -v gnucap >/dev/null || return 1
    ! command -v dpkg-query >/dev/null || dpkg-query -W $PLUGINS >/dev/null 2>&1
}

is_complete && exit
[ -e "$1" ] && exit
# shellcheck source=scripts/system.sh
source scripts/system.sh
if may_install; then
    say "installing gnucap, for tests"
    apt_get update || true # a broken third-party source does no harm here
    apt_install gnucap $PLUGINS || true
fi
is_complete && exit
touch "$1"
say "no gnucap here: its tests are skipped (in CI they fail); as root: apt-get install gnucap $PLUGINS"
