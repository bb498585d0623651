#!/bin/sh
# Times carved and its peers on this machine and writes docs/performance.md. See README.md.
#
#   run.sh [segmentation|carve|instructions|all]
#
#   CARVED_PEERS_VENV   where the peers are installed       (target/peers-venv)
#   CARVED_PEERS_DATA   where the phantom's views are kept  (target/peers-data)
set -eu

here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
venv=${CARVED_PEERS_VENV:-target/peers-venv}
data=${CARVED_PEERS_DATA:-target/peers-data}
# Keeps compiled Python files out of the source folder.
mkdir -p target
export PYTHONDONTWRITEBYTECODE=1 NUMBA_CACHE_DIR="$PWD/target/peers-numba"

peers() {
    [ -x "$venv/bin/python" ] || python3 -m venv "$venv"
    cmp -s "$here/requirements.txt" "$venv/installed.txt" && return
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$here/requirements.txt"
    cp "$here/requirements.txt" "$venv/installed.txt"
}

phantom() {
    [ -e "$data/done" ] && return
    "$venv/bin/python" "$here/phantom.py" "$data"
    touch "$data/done"
}

part() {
    case $1 in
    segmentation)
        peers
        phantom
        frames=$(mktemp -d)
        trap 'rm -rf "$frames"' EXIT
        "$venv/bin/python" "$here/segmentation.py" "$data" "$frames"
        ;;
    carve)
        peers
        phantom
        "$venv/bin/python" "$here/carve.py" "$data"
        ;;
    instructions)
        command -v valgrind >/dev/null || { echo "instructions: skipped, there is no valgrind (apt-get install valgrind)"; return; }
        peers
        phantom
        "$venv/bin/python" "$here/instructions.py" "$data"
        ;;
    *)
        sed -n 's/^# \{0,1\}//p' "$0" | sed 1d >&2
        exit 2
        ;;
    esac
}

case ${1:-all} in
all) for each in segmentation carve instructions; do part "$each"; done ;;
*) part "$1" ;;
esac
