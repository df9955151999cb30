# Sourced from the project's root: makes .venv with the project and its tools when it is missing or
# was made for another pyproject.toml. PYTHON names the interpreter; otherwise the first that fits.

usable() {
    "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null
}

if [ -z "${PYTHON:-}" ]; then
    for PYTHON in python3 python3.13 python3.12 python3.11 python3.10; do
        usable "$PYTHON" && break
    done
fi
usable "$PYTHON" || {
    echo "moar-companion needs Python 3.10 to 3.13; set PYTHON to one" >&2
    exit 1
}

wanted=$(cat pyproject.toml constraints.txt | cksum)
if [ "$(cat .venv/installed 2>/dev/null)" != "$wanted" ]; then
    echo "installing into .venv (once)" >&2
    [ -x .venv/bin/python ] || "$PYTHON" -m venv .venv || {
        echo "$PYTHON cannot make a virtual environment (on Debian: apt install python3-venv)" >&2
        exit 1
    }
    .venv/bin/python -m pip install --quiet --disable-pip-version-check \
        --constraint constraints.txt --editable '.[dev]' >&2
    echo "$wanted" >.venv/installed
fi
