#!/usr/bin/env bash
# Make the checkout ready to work: .venv from the pinned versions in requirements/, taction itself
# in editable form, ngspice where it is missing. When nothing has changed since the last run it
# returns at once.
#
# setup.sh demo [--again]    what a user needs: taction, plots and reports
# setup.sh dev [--again]     the tools of developers, too; `--again` retries an ngspice installation
#                            that failed before
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

LEVEL=$1
VENV=.venv
STAMP=$VENV/.set-up
# A caller's own Python or pip settings must not leak into the environment we build.
unset PYTHONPATH PYTHONHOME PIP_TARGET PIP_PREFIX
export PIP_USER=0 PIP_NO_INPUT=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore

# Everything that decides what is in .venv. The folder counts: a moved .venv has stale launchers.
fingerprint() {
    { pwd && cat requirements/*.txt pyproject.toml scripts/setup.sh; } | sha256sum | cut -d ' ' -f 1
}

is_recent() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

# The stamp has the level and the fingerprint of what is installed; `dev` holds all of `demo`.
is_current() {
    local level found
    [ -f "$STAMP" ] && read -r level found <"$STAMP" && [ "$found" = "$(fingerprint)" ] &&
        { [ "$level" = "$LEVEL" ] || [ "$level" = dev ]; } && is_recent $VENV/bin/python
}

find_python() {
    local python
    for python in ${PYTHON:-} python3 python3.13 python3.12 python3.11; do
        if is_recent "$python"; then
            printf '%s\n' "$python"
            return
        fi
    done
    say "no Python 3.11 or newer found (python3 is $(python3 --version 2>&1 || true))."
    say "install one, or name it: make setup PYTHON=/path/to/python3.11"
    return 1
}

has_ensurepip() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

# Debian and Ubuntu keep `ensurepip` in a package of its own. Without it and without the right to
# install it, a pip that the interpreter already has can still fill an empty environment.
create_venv() {
    local python package
    python=$(find_python)
    say "step 1 of 3: $VENV with $("$python" --version)"
    if ! has_ensurepip "$python"; then
        package=python$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv
        say "this Python has no ensurepip; installing $package"
        if may_install; then
            apt_get update || true
            apt_install "$package" || true
        fi
    fi
    if has_ensurepip "$python"; then
        "$python" -m venv --clear $VENV
    elif "$python" -m pip --version >/dev/null 2>&1; then
        "$python" -m venv --clear --without-pip $VENV
        "$python" -m pip --python $VENV/bin/python install -q pip
    else
        say "cannot create $VENV: $package is missing and may not be installed from here."
        say "as root: apt-get install $package; then run make again."
        return 1
    fi
}

fill_venv() {
    local quiet=(-q)
    [ -t 2 ] && quiet=() # a terminal shows pip's own progress
    say "step 2 of 3: $(grep -c == "requirements/$LEVEL.txt") pinned packages, a minute or two"
    # Modules that nothing imports need no bytecode: it is 100 MB of the demonstration.
    $VENV/bin/python -m pip install --no-compile "${quiet[@]}" -r "requirements/$LEVEL.txt"
    # `compat` is a plain path entry: the default import hook costs every start 10 ms.
    $VENV/bin/python -m pip install -q --no-deps --no-build-isolation \
        --config-settings editable_mode=compat -e .
}

if ! is_current; then
    # Two `make` at once: the second waits here and then finds everything done.
    exec 9<scripts/setup.sh
    command -v flock >/dev/null && flock 9
    if ! is_current; then
        rm -f "$STAMP"
        if ! is_recent $VENV/bin/python || ! $VENV/bin/python -m pip --version >/dev/null 2>&1; then
            create_venv
        fi
        fill_venv
        echo "$LEVEL $(fingerprint)" >"$STAMP"
    fi
fi
bash scripts/ngspice.sh "$VENV/.ngspice-tried" "${@:2}"
