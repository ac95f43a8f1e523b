#!/usr/bin/env bash
# Install zsh and fish for the tests of shell completion, where they are missing and may be
# installed. Exit status 0 also without them: the tests then skip, in CI they fail.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

missing=()
for name in zsh fish; do
    command -v "$name" >/dev/null || missing+=("$name")
done
[ ${#missing[@]} -eq 0 ] && exit
if may_install; then
    say "installing ${missing[*]}"
    apt_get update || true # a broken third-party source does no harm here
    apt_install "${missing[@]}" || true
else
    say "no ${missing[*]} here, and they may not be installed; as root: apt-get install ${missing[*]}"
fi
