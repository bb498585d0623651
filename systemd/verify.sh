#!/bin/sh
# Checks the unit, its slice, its drop-in and the udev rule without installing them or the daemon.
set -eu
here=$(dirname "$(readlink -f "$0")")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# `verify` requires an existing program, so another one is used in its place.
mkdir "$work/carved.service.d"
sed "s|^ExecStart=/usr/bin/carved |ExecStart=$(command -v true) |" "$here/carved.service" >"$work/carved.service"
cp "$here/camera-subnet.conf" "$work/carved.service.d/"
cp "$here/carved.slice" "$work/"
complaints=$(systemd-analyze verify --man=no "$work/carved.service" "$work/carved.slice" 2>&1 || echo "exit code $?")
if [ -n "$complaints" ]; then
    echo "systemd-analyze verify: $complaints" >&2
    exit 1
fi

# The threshold is in tenths: at most 1.5 of 10. The table is printed on stdout only if the unit fails.
if ! table=$(systemd-analyze security --no-pager --offline=true --threshold=15 "$here/carved.service" 2>&1); then
    echo "$table" >&2
    exit 1
fi
echo "$table" | tail -n 1

# Debian 12's udev has no `udevadm verify`. Without it the form of the lines is checked.
if udevadm verify --help >/dev/null 2>&1; then
    udevadm verify "$here/60-carved.rules"
else
    pair='[A-Z]+([{][A-Za-z_]+[}])?(==|!=|=|[+]=|:=)"[^"]*"'
    if wrong=$(grep -nvE "^(|#.*|$pair(, $pair)*)\$" "$here/60-carved.rules"); then
        echo "60-carved.rules: not a list of KEY==\"value\" and KEY=\"value\": $wrong" >&2
        exit 1
    fi
fi
