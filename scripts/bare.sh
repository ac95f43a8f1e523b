#!/usr/bin/env bash
# Run commands in a minimal system: Debian of this machine's release, made by mmdebstrap from the
# machine's own apt sources, with python3, python3-venv, make and git and nothing else. A clone of
# the last commit is put in, with the machine's settings of pip and apt. So a run shows whether the
# set-up scripts install what they need. Only as root; the folder is removed at the end.
#
# bare.sh [COMMAND ...]    each COMMAND is a line for bash; the default is "make demo" "make test".
# RELEASE=trixie names another release of Debian. Exit status 1 if a command failed, 3 if there
# could be no such system.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
    say "a bare system needs root and apt; nothing was tested in one"
    exit 3
fi
if [ "${TACTION_BARE:-}" != inside ]; then # mounts of its own, which end with this process
    if ! unshare --mount true 2>/dev/null; then
        say "a bare system needs mounts of its own, which this machine refuses; nothing was tested in one"
        exit 3
    fi
    TACTION_BARE=inside exec unshare --mount --propagation private bash "$0" "$@"
fi
if ! command -v mmdebstrap >/dev/null; then
    say "installing mmdebstrap"
    apt_get update || true
    apt_install mmdebstrap || exit 3
fi

[ $# -gt 0 ] || set -- "make demo" "make test"
bare=$(mktemp -d "${TMPDIR:-/tmp}/taction-bare-XXXXXX")
# What is mounted there is this machine's: nothing is removed before all of it is let go.
finish() {
    awk -v at="$bare/" 'index($5, at) == 1 { print $5 }' /proc/self/mountinfo | sort -r |
        while IFS= read -r mount; do umount --lazy "$mount" 2>/dev/null || true; done
    if grep -qF " $bare/" /proc/self/mountinfo; then
        say "$bare still holds mounts of this machine; it is not removed"
    else
        rm -rf --one-file-system "$bare"
    fi
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# Debian's own suites only: what the machine got from elsewhere, or from backports, is not bare.
release=${RELEASE:-$(. /etc/os-release && printf '%s' "$VERSION_CODENAME")}
mirror=$(awk '/^URIs:/ { print $2; exit } /^deb / { for (i = 2; i <= NF; i++) if ($i ~ /^http/) { print $i; exit } }' \
    /etc/apt/sources.list.d/debian.sources /etc/apt/sources.list 2>/dev/null | head -n 1)
settings=()
while IFS= read -r file; do # lines such as proxies and time limits, as on this machine
    settings+=("--aptopt=$file")
done < <(grep -lE '^ *Acquire' /etc/apt/apt.conf.d/* 2>/dev/null || true)
began=$SECONDS
say "making a minimal Debian $release"
mmdebstrap --quiet --variant=apt --include=ca-certificates,git,make,python3,python3-venv \
    "${settings[@]}" "$release" "$bare" "deb $mirror $release main" \
    "deb $mirror $release-updates main" || exit 3
say "made in $((SECONDS - began)) s, $(du -sm "$bare" | cut -f 1) MB"

mount -t proc proc "$bare/proc" && mount --rbind /dev "$bare/dev" || exit 3
cp /etc/resolv.conf /etc/hosts "$bare/etc/" 2>/dev/null || true
home=${HOME:-/root} # the same inside, so that settings of pip are found
mkdir -p "$bare/usr/local/share/ca-certificates" "$bare$home"
cp -r /etc/ssl/certs/. "$bare/etc/ssl/certs/" 2>/dev/null || true
for file in /etc/pip.conf "$home/.config/pip/pip.conf" "$home/.pip/pip.conf"; do
    [ -e "$file" ] && mkdir -p "$bare$(dirname "$file")" && cp "$file" "$bare$file"
done
# Folders of packages on this machine that pip's settings name are there, too, read only.
settings_of_pip() { { env | grep '^PIP_'; cat "$bare"/etc/pip.conf "$bare$home/.config/pip/pip.conf" \
    "$bare$home/.pip/pip.conf"; } 2>/dev/null || true; }
bound=()
for folder in $(settings_of_pip | grep -oE '(file://)?/[^ ,]+' | sed 's,^file://,,' | sort -u); do
    [ "$(basename "$folder")" = simple ] && folder=$(dirname "$folder") # an index beside its files
    [ -d "$folder" ] && ! mountpoint -q "$bare$folder" || continue
    mkdir -p "$bare$folder"
    mount --bind "$folder" "$bare$folder"
    mount -o remount,bind,ro "$bare$folder"
    bound+=("$bare$folder")
done

git clone --quiet --no-hardlinks . "$bare/home/taction"
variables=(HOME="$home" PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin TERM=dumb)
for name in LANG CI JOBS; do [ -n "${!name:-}" ] && variables+=("$name=${!name}"); done
while IFS= read -r pair; do variables+=("$pair"); done < <(env | grep -iE '^(PIP_|SSL_CERT_(FILE|DIR)=|[a-z]*_?proxy=)' || true)

# What pip reads from this machine is no part of the system.
used() { du -sm "${bound[@]/#/--exclude=}" --exclude="$bare/dev" --exclude="$bare/proc" "$bare" | cut -f 1; }

status=0
for command in "$@"; do
    began=$SECONDS
    say "in the bare system: $command"
    chroot "$bare" env -i "${variables[@]}" bash -c "cd /home/taction && $command" </dev/null || status=1
    say "$command: $((SECONDS - began)) s, $(used) MB in the system"
done
exit $status
