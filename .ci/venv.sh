# Sourced (sh or bash) in the project's root: makes $venv, a virtual environment with the project and
# its tools, when it is missing, unfinished or older than pyproject.toml and constraints.txt.
# Quiet when nothing is to be done. From the environment:
#   PYTHON     the interpreter, 3.10 to 3.13; otherwise the first on PATH that can be used
#   MOAR_VENV  the folder instead of .venv

venv=${MOAR_VENV:-.venv}

can() {  # can INTERPRETER MODULES: it runs, is of a version that fits, and has these modules
    "$1" -c "import sys, $2; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))" \
        >/dev/null 2>&1
}

version() {
    "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}

refuse() {
    echo "$1" >&2
    exit 1
}

# The checkout's place is part of the stamp: a virtual environment does not survive a move.
stamp() {
    cat pyproject.toml constraints.txt | cksum
    pwd
}

fits() {  # the virtual environment runs, and is of the version that was asked for
    can "$venv/bin/python" pip || return 1
    [ -z "${PYTHON:-}" ] || [ "$(version "$venv/bin/python")" = "$(version "$PYTHON")" ] || return 1
    [ ! -e "$venv/installed" ] || [ "$(tail -n 1 "$venv/installed")" = "$(pwd)" ]
}

choose() {  # sets python, or says in one line what is missing
    without_venv=
    for python in ${PYTHON:+"$PYTHON"} python3 python3.13 python3.12 python3.11 python3.10; do
        can "$python" 'venv, ensurepip' && return
        can "$python" sys && without_venv=${without_venv:-$python}
        [ -z "${PYTHON:-}" ] || break
    done
    if [ -n "$without_venv" ]; then
        refuse "$without_venv cannot make virtual environments: install python$(version "$without_venv")-venv (on Debian and Ubuntu: apt install python3-venv)"
    fi
    if [ -n "${PYTHON:-}" ]; then
        refuse "PYTHON=$PYTHON is not a Python 3.10 to 3.13"
    fi
    refuse "no Python 3.10 to 3.13 on PATH: install one, or name one with PYTHON="
}

if ! fits; then
    choose
    echo "making $venv with Python $(version "$python")" >&2
    "$python" -m venv --clear "$venv" >&2 || refuse "$python could not make $venv"
fi
if [ "$(cat "$venv/installed" 2>/dev/null)" != "$(stamp)" ]; then
    echo "installing the project and its tools into $venv (once, a minute or two)" >&2
    rm -f "$venv/installed"
    pip() {
        "$venv/bin/python" -m pip -qq --disable-pip-version-check "$@" >&2
    }
    # Modules are compiled when they are first imported: most never are.
    pip install --no-compile --constraint constraints.txt --upgrade pip &&
        pip install --no-compile --constraint constraints.txt \
            --build-constraint constraints.txt --editable '.[dev]' ||
        refuse "could not install into $venv (see above); it is tried again next time"
    unset -f pip
    stamp >"$venv/installed"
fi
