#!/usr/bin/env bash
# Give the machine gnucap, the simulator beside ngspice that reads decks of other dialects in tests.
# Never fails: without it these tests are skipped (in CI they fail).
#
# gnucap.sh MARK    MARK remembers an attempt that failed, so that the next run does not ask the
#                   network again; `make clean` removes it with .venv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

command -v gnucap >/dev/null && exit
[ -e "$1" ] && exit
# shellcheck source=scripts/system.sh
source scripts/system.sh
if may_install; then
    say "installing gnucap, for tests"
    apt_get update || true # a broken third-party source does no harm here
    apt_install gnucap || true
fi
command -v gnucap >/dev/null && exit
touch "$1"
say "no gnucap here: its tests are skipped (in CI they fail); as root: apt-get install gnucap"
