# shellcheck shell=bash
# Sourced: packages that Debian 12 has too old, from the backports of the machine's own mirror.

# shellcheck source=scripts/system.sh
source scripts/system.sh

backports_known() { [[ "$(apt-cache madison "$2" 2>/dev/null)" == *" $1-backports/"* ]]; }

# The mirror is the machine's own, of which apt knows that it carries Debian's archive; the key is
# Debian's own.
add_backports() {
    local codename=$1 package=$2 uri entry=/etc/apt/sources.list.d/taction-backports.list
    # shellcheck disable=SC2016  # apt expands REPO_URI, not the shell
    uri=$(apt-get indextargets --format '$(REPO_URI)' \
        'Created-By: Packages' 'Origin: Debian' "Codename: $codename" 'Component: main')
    [ -n "$uri" ] || return 1
    printf 'deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] %s %s-backports main\n' \
        "${uri%%$'\n'*}" "$codename" | as_root tee "$entry" >/dev/null || return 1
    say "added $entry, for $package only (backports are never taken unasked)"
    apt_get update || true
    if ! backports_known "$codename" "$package"; then
        say "this mirror has no $codename-backports; removing $entry"
        as_root rm -f "$entry"
        apt_get update || true
        return 1
    fi
}

# Install a package: from the backports on Debian 12, from the distribution elsewhere.
install_newest() {
    local package=$1 codename
    # shellcheck source=/dev/null
    codename=$(. /etc/os-release 2>/dev/null && echo "${ID:-}-${VERSION_CODENAME:-}")
    apt_get update || true # a broken third-party source does no harm here
    if [ "$codename" = debian-bookworm ]; then
        if backports_known bookworm "$package" || add_backports bookworm "$package"; then
            apt_install -t bookworm-backports "$package" && return
        fi
    fi
    apt_install "$package"
}
