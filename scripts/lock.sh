#!/usr/bin/env bash
# Write requirements/*.txt anew: the newest versions that pyproject.toml allows, resolved by the
# oldest Python we support, every transitive one pinned. demo.txt adds to runtime.txt what a
# checkout needs to write reports and to be installed in editable form, dev.txt the rest.
# With --keep what is pinned stays, and only new packages get a version.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=scripts/system.sh
source scripts/system.sh

PYTHON=${PYTHON:-python3.11}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$PYTHON" -m venv "$work/venv"
python=$work/venv/bin/python
"$python" - "$work" <<'EOF'
import sys, tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text("utf-8"))["project"]
folder = Path(sys.argv[1])
extras = project["optional-dependencies"]
build = [line for line in extras["dev"] if line.startswith("setuptools")]
(folder / "runtime.in").write_text("\n".join(project["dependencies"]))
(folder / "demo.in").write_text("\n".join([*extras["plot"], *extras["report"], *build]))
(folder / "dev.in").write_text("\n".join(extras["dev"]))
EOF

constraints=()
if [[ ${1-} == --keep ]]; then
    # Plain lines: the `-r` of a file of constraints would ask for all of its packages.
    grep -h == requirements/*.txt >"$work/constraints.txt"
    constraints=(-c "$work/constraints.txt")
fi

freeze() { "$python" -m pip freeze --all --exclude pip; }

# A virtual environment of Python 3.11 brings a setuptools of its own; only `dev.in` asks for one.
"$python" -m pip uninstall -q -y setuptools
say "resolving the runtime packages"
"$python" -m pip install -q "${constraints[@]}" -r "$work/runtime.in"
freeze >"$work/runtime.txt"
say "resolving the packages of the demonstration"
"$python" -m pip install -q "${constraints[@]}" -c "$work/runtime.txt" -r "$work/demo.in"
freeze >"$work/demo.txt"
say "resolving the development packages"
"$python" -m pip install -q "${constraints[@]}" -c "$work/demo.txt" -r "$work/dev.in"
freeze >"$work/all.txt"

{
    echo "# What taction runs on. Written by \`make lock\`; do not edit."
    cat "$work/runtime.txt"
} >requirements/runtime.txt
{
    echo "# Reports, and the editable install. Written by \`make lock\`; do not edit."
    echo "-r runtime.txt"
    grep -vxFf "$work/runtime.txt" "$work/demo.txt"
} >requirements/demo.txt
{
    echo "# Tests, checks and the build. Written by \`make lock\`; do not edit."
    echo "-r demo.txt"
    grep -vxFf "$work/demo.txt" "$work/all.txt"
} >requirements/dev.txt
