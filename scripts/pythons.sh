#!/usr/bin/env bash
# Run tests with the newest Python on this machine that is newer than the one of .venv: the pinned
# packages go into .venv-VERSION, beside .venv. Says so where there is none. With --all (the first
# argument) it runs all tests with every newer Python; one that is missing is asked of uv, apt and
# pyenv's folders, and named where none has it. Other arguments go to pytest.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

unset PYTHONPATH PYTHONHOME PIP_TARGET PIP_PREFIX
export PIP_USER=0 PIP_NO_INPUT=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
NEWER=(3.14 3.13 3.12)
# What depends on Python: every engine and reading, processes, documents of types, all commands once.
TESTS=(tests/verification/engines tests/verification/readings tests/verification/reference)
TESTS+=(tests/verification/studies/running tests/netlist_gen/deck tests/system)
TESTS+=(tests/cli/test_contract.py)
all=
if [ "${1-}" = --all ]; then
    shift
    all=yes TESTS=(tests)
fi

is_version() { [ "$("$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = "$2" ]; }

# Where a system, pyenv or uv keeps its interpreters.
installed_python() {
    local version=$1 candidate
    for candidate in "python$version" "$HOME/.pyenv/versions/$version".*/bin/python \
        "$HOME/.local/share/uv/python/cpython-$version".*/bin/python; do
        if is_version "$candidate" "$version"; then
            printf '%s\n' "$candidate"
            return
        fi
    done
    return 1
}

# The same; with --all one that is missing is installed by uv or apt, where they have it.
find_python() {
    local version=$1
    installed_python "$version" && return
    [ -n "$all" ] || return 1
    .venv/bin/python -m uv python install -q "$version" 2>/dev/null ||
        { may_install && apt_install "python$version-venv" >/dev/null 2>&1; } || return 1
    installed_python "$version"
}

prepare() {
    local python=$1 venv=$2 wanted
    wanted=$({ pwd && cat requirements/*.txt pyproject.toml; } | sha256sum)
    [ -f "$venv/.set-up" ] && [ "$(<"$venv/.set-up")" = "$wanted" ] && return
    say "creating $venv with $("$python" --version)"
    "$python" -m venv --clear "$venv"
    "$venv/bin/python" -m pip install -q --no-compile -r requirements/dev.txt
    "$venv/bin/python" -m pip install -q --no-deps --no-build-isolation \
        --config-settings editable_mode=compat -e .
    printf '%s\n' "$wanted" >"$venv/.set-up"
}

status=0 found=
for version in "${NEWER[@]}"; do
    if is_version .venv/bin/python "$version"; then
        say "no newer Python than $version of .venv is left to test"
        break
    fi
    if ! python=$(find_python "$version"); then
        say "Python $version: not on this machine"
        continue
    fi
    found=$version
    prepare "$python" ".venv-$version"
    say "tests with Python $version"
    ".venv-$version/bin/python" -m pytest "${TESTS[@]}" "$@" || status=1
    [ -n "$all" ] || break
done
[ -n "$found" ] || say "no Python newer than that of .venv on this machine"
exit $status
