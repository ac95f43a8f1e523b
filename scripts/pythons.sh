#!/usr/bin/env bash
# Run tests with the newest Python on this machine that is newer than the one of .venv: the pinned
# packages go into .venv-VERSION, beside .venv. Says so where there is none. Other arguments than
# these, of which one may come first, go to pytest.
#
# --all             all tests with every newer Python; one that is missing is asked of uv, apt and
#                   pyenv's folders, and named where none has it
# --kernels NAME    the numerical tests and scenes/ with these BLAS kernels at the same time: one run
#                   shows both. Where there is no newer Python, with that of .venv
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

unset PYTHONPATH PYTHONHOME PIP_TARGET PIP_PREFIX
export PIP_USER=0 PIP_NO_INPUT=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
NEWER=(3.14 3.13 3.12)
ROOMS=(engines readings reference) # the numerical tests
# What else depends on Python: processes, files, plugins, documents of types, all commands once.
OTHERS=(tests/verification/studies/running/test_pool.py tests/system tests/cli/test_contract.py)
all= kernels=
case ${1-} in
--all) shift && all=yes ;;
--kernels) kernels=$2 && shift 2 ;;
esac

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

numerical() {
    local python=$1
    shift
    if [ -n "$kernels" ]; then
        "$python" scripts/processors.py --others --kernels "$kernels" --threads 1 --scenes \
            --tests "${ROOMS[@]}" -- "$@"
    else
        "$python" -m pytest "${ROOMS[@]/#/tests/verification/}" "$@"
    fi
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
    if [ -n "$all" ]; then
        ".venv-$version/bin/python" -m pytest tests "$@" || status=1
    else
        numerical ".venv-$version/bin/python" "$@" || status=1
        ".venv-$version/bin/python" -m pytest "${OTHERS[@]}" "$@" || status=1
        break
    fi
done
if [ -z "$found" ]; then
    say "no Python newer than that of .venv on this machine"
    [ -z "$kernels" ] || numerical .venv/bin/python "$@" || status=1
fi
exit $status
