#!/usr/bin/env bash
# Print the path of a Chromium for the tests of reports; install the distribution's where it is
# missing and may be installed. Exit status 1: there is none.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

find_chromium() {
    local name
    for name in ${TACTION_BROWSER:-} chromium chromium-browser google-chrome; do
        command -v "$name" && return
    done
    return 1
}

find_chromium && exit
if may_install; then
    say "installing Chromium"
    apt_get update || true # a broken third-party source does no harm here
    # The driver of playwright is a node that needs libatomic.
    apt_install chromium fonts-dejavu-core libatomic1 || true
fi
find_chromium && exit
say "no Chromium here, and it may not be installed; as root: apt-get install chromium"
say "or name one: make test-browser TACTION_BROWSER=/path/to/chromium"
exit 1
