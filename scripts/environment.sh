# Makes .venv with what the program needs, where it is missing; sourced by run and test.
#
# Wants: nothing. Leaves: root, the folder of the project. All output goes to standard error.
# Two at once wait for each other, on a lock that a killed script gives back.

root=$(CDPATH='' cd -- "$(dirname -- "$(readlink -f -- "$0")")/.." && pwd)
# Whatever else PYTHONPATH leads to, the package of this project comes first.
PYTHONPATH=$root/src${PYTHONPATH:+:$PYTHONPATH}
export PYTHONPATH

# The newest Python that is recent enough and can make virtual environments.
find_python() {
    recent=
    for candidate in python3.14 python3.13 python3.12 python3.11 python3 python; do
        "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || continue
        recent=$candidate
        if "$candidate" -c 'import ensurepip, venv' 2>/dev/null; then
            printf '%s\n' "$candidate"
            return
        fi
    done
    if [ -n "$recent" ]; then
        version=$("$recent" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        fail "found Python $version ($recent), but it cannot make virtual environments:" \
            "install its venv module (on Debian and Ubuntu: apt-get install python$version-venv)"
    fi
    fail "found no Python 3.11 or newer on PATH: install one (on Debian and Ubuntu:" \
        "apt-get install python3 python3-venv; anywhere: https://www.python.org/downloads/)"
}

fail() {
    printf '%s: %s\n' "$(basename -- "$0")" "$*" >&2
    exit 1
}

# What an installation was made from: it is made again when this changes.
wanted_stamp() {
    printf '%s\n' "$root"
    cksum <"$root/pyproject.toml"
}

# $1: what to install (run: the program; docs: what its website needs; test: what its tests need as well).
install() {
    for kind in "$1" test; do
        if [ -x "$root/.venv/bin/python" ] && [ "$(cat "$root/.venv/.installed-$kind" 2>/dev/null)" = "$(wanted_stamp)" ] &&
            "$root/.venv/bin/python" -c '' 2>/dev/null; then
            return
        fi
    done
    if ! "$root/.venv/bin/python" -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
        ! grep -qF "$root/.venv" "$root/.venv/bin/activate"; then
        # Missing, broken, or moved here from another folder: its scripts name that one.
        python=$(find_python) || exit 1
        echo "making a virtual environment in $root/.venv with $("$python" --version)" >&2
        "$python" -m venv --clear "$root/.venv" >&2 ||
            fail "the virtual environment could not be made; the reason is above"
    fi
    what=$root
    [ "$1" = run ] || what="$root[$1]"
    echo "installing into $root/.venv" >&2
    "$root/.venv/bin/python" -m pip install --disable-pip-version-check --quiet --editable "$what" >&2 ||
        fail "the installation failed; the reason is above (a network is needed the first time)"
    wanted_stamp >"$root/.venv/.installed-$1"
}

# $1: as for install.
ensure_environment() {
    if command -v flock >/dev/null; then
        exec 9<"$root/pyproject.toml"
        flock 9
    fi
    install "$1"
    exec 9<&-
}
