# shellcheck shell=bash
# Sourced by the set-up scripts: messages, and packages of the system where we may install them.

say() { printf 'set-up: %s\n' "$*" >&2; }

# Root as it is, sudo without a password, or sudo with one where somebody sits at a terminal.
may_install() {
    command -v apt-get >/dev/null || return 1
    [ "$(id -u)" -eq 0 ] && return
    command -v sudo >/dev/null || return 1
    sudo -n true 2>/dev/null && return
    [ -t 0 ] && [ -z "${CI:-}" ] && sudo -v
}

as_root() {
    if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}

# apt-get without a question ever; silent unless it fails. Two scripts at once wait for each other.
apt_get() {
    local log locked=()
    log=$(mktemp)
    command -v flock >/dev/null && locked=(flock "${TMPDIR:-/tmp}/taction-apt.lock")
    if as_root "${locked[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -y \
        -o DPkg::Lock::Timeout=300 -o Acquire::Retries=3 \
        -o Dpkg::Options::=--force-confdef -o Dpkg::Options::=--force-confold \
        "$@" </dev/null >"$log" 2>&1; then
        rm -f "$log"
        return
    fi
    say "apt-get $* failed:"
    tail -n 5 "$log" >&2
    rm -f "$log"
    return 1
}

apt_install() { apt_get install --no-install-recommends "$@"; }
