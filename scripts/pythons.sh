#!/usr/bin/env bash
# Run tests with the newest Python on this machine that is newer than that of .venv: the pinned
# packages go into .venv-VERSION, beside .venv. The stress catalogue, whose true readings are known,
# and the baseline run with it and with the BLAS kernels of old processors at the same time: one run
# shows both. Without a newer Python that of .venv runs them.
#
# pythons.sh [--all] [ARGUMENTS]    --all: all tests with every newer Python; ARGUMENTS are pytest's
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

unset PYTHONPATH PYTHONHOME PIP_TARGET PIP_PREFIX
export PIP_USER=0 PIP_NO_INPUT=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
# What else depends on Python: processes, files, plugins, documents of types, all commands once.
OTHERS=(tests/verification/studies/running/test_pool.py tests/system tests/cli/test_contract.py)
# The packages that these need beside those of a user.
TOOLS=(hypothesis jsonschema pytest pytest-xdist spicelib)
all=
[ "${1-}" = --all ] && shift && all=yes

# The interpreter of a version: a system's, pyenv's or uv's.
find_python() {
    local candidate
    for candidate in "python$1" "$HOME/.pyenv/versions/$1".*/bin/python \
        "$HOME/.local/share/uv/python/cpython-$1".*/bin/python; do
        "$candidate" -c '' 2>/dev/null && printf '%s\n' "$candidate" && return
    done
    return 1
}

prepare() {
    local python=$1 venv=$2 wanted
    wanted=$({ pwd && echo "$all ${TOOLS[*]}" && cat requirements/*.txt pyproject.toml; } | sha256sum)
    [ -f "$venv/.set-up" ] && [ "$(<"$venv/.set-up")" = "$wanted" ] && return
    say "creating $venv with $("$python" --version)"
    "$python" -m venv --clear --without-pip "$venv"
    local pip=(.venv/bin/python -m pip --python "$venv/bin/python" install -q)
    if [ -n "$all" ]; then
        "${pip[@]}" --no-compile -r requirements/dev.txt
    else
        "${pip[@]}" --no-compile -r requirements/demo.txt -c requirements/dev.txt "${TOOLS[@]}"
    fi
    "${pip[@]}" --no-deps --no-build-isolation --config-settings editable_mode=compat -e .
    printf '%s\n' "$wanted" >"$venv/.set-up"
}

own=$(.venv/bin/python -c 'import sys; print("%d.%d" % sys.version_info[:2])')
status=0 newest=.venv
for version in 3.14 3.13 3.12; do
    [ "$version" = "$own" ] && break
    python=$(find_python "$version") || { say "Python $version: not on this machine" && continue; }
    [ "$newest" = .venv ] && newest=.venv-$version
    prepare "$python" ".venv-$version"
    say "tests with Python $version"
    if [ -n "$all" ]; then
        ".venv-$version/bin/python" -m pytest tests "$@" || status=1
    else
        ".venv-$version/bin/python" -m pytest "${OTHERS[@]}" "$@" || status=1
        break
    fi
done
if [ -z "$all" ]; then
    export OPENBLAS_CORETYPE=Prescott
    say "stress catalogue and baseline with $("$newest/bin/python" --version), kernels of $OPENBLAS_CORETYPE"
    "$newest/bin/python" -m taction self stress --jobs "${JOBS:-2}" || status=1
    "$newest/bin/python" -m taction regress scenes/ --baseline scenes/baseline.json || status=1
fi
exit $status
