#!/usr/bin/env bash
# Run tests with the newest Python on this machine that is newer than the one of .venv: the pinned
# packages go into .venv-VERSION, beside .venv. Says so where there is none. With --all (the first argument) it runs
# all tests. Other arguments go to pytest.
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
if [ "${1-}" = --all ]; then
    shift
    TESTS=(tests)
fi

is_version() { [ "$("$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = "$2" ]; }

# Where a system, pyenv or uv keeps its interpreters.
find_python() {
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

prepare() {
    local python=$1 venv=$2 wanted
    wanted=$({ pwd && cat requirements/*.txt pyproject.toml; } | sha256sum)
    [ -f "$venv/.set-up" ] && [ "$(<"$venv/.set-up")" = "$wanted" ] && return
    say "creating $venv with $("$python" --version)"
    "$python" -m venv --clear "$venv"
    "$venv/bin/python" -m pip install -q -r requirements/dev.txt
    "$venv/bin/python" -m pip install -q --no-deps --no-build-isolation \
        --config-settings editable_mode=compat -e .
    printf '%s\n' "$wanted" >"$venv/.set-up"
}

for version in "${NEWER[@]}"; do
    if is_version .venv/bin/python "$version"; then
        say ".venv has the newest Python of this machine"
        exit 0
    fi
    if python=$(find_python "$version"); then
        prepare "$python" ".venv-$version"
        exec ".venv-$version/bin/python" -m pytest "${TESTS[@]}" "$@"
    fi
done
say "no Python newer than that of .venv on this machine"
