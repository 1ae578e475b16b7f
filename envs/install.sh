#!/usr/bin/env bash
# Make the environment: a virtual environment in .venv with the project in it, in one of two ways.
#   debian   Debian 12 and its own dolfinx, for its own Python; Debian packages that are missing are
#            installed by root, or with sudo after a question
#   wheel    any other Linux on x86-64 with Python 3.12 or newer: wheels only, nothing as root
# PYTHON=/path/to/python3.13 chooses the Python, and with it the way. See docs/install.md.
# Does nothing if .venv was made from the same files, in the same place and with the same Python.
# Called by `make env`, and with the argument `test` by `make test`, whose Debian packages come on top.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

die() {
    printf '%s\n' "$@" >&2
    exit 1
}

is() { # is <python> <version>: whether it is a Python of at least this version
    [[ -n $(type -P "$1") ]] && "$1" -c "import sys; sys.exit(sys.version_info < ($2))" 2>/dev/null
}

is_debian_12() {
    (. /etc/os-release && [[ ${ID:-} == debian && ${VERSION_ID:-} == 12 ]]) 2>/dev/null
}

venv=.venv
stamp=$venv/.stamp${1:+-$1}
debian=(envs/debian-packages.txt ${1:+"envs/debian-packages-$1.txt"})
way=wheel
if [[ -n ${PYTHON:-} ]]; then
    is "$PYTHON" '3, 12' || die "PYTHON=$PYTHON is not a Python of version 3.12 or newer."
    python=$PYTHON
elif is_debian_12 && is /usr/bin/python3 '3, 11'; then
    # Debian's dolfinx belongs to Debian's own Python, whatever comes first on PATH.
    way=debian python=/usr/bin/python3
else
    for python in python3.14 python3.13 python3.12 python3 ''; do
        if is "${python:-false}" '3, 12'; then
            break
        fi
    done
fi
lock=envs/requirements.txt
if [[ $way == wheel ]]; then
    lock=envs/requirements-wheel.txt
    [[ $(uname -sm) == 'Linux x86_64' ]] ||
        die "The simulator's wheel is for Linux on x86-64; this is $(uname -sm)." \
            'Use such a machine, or Debian 12, whose packages are built for other processors too.'
    [[ -n $python ]] ||
        die 'Neither Debian 12 nor a Python of version 3.12 or newer was found. Install one (no root' \
            'is needed: `uv python install 3.13`, pyenv, or python.org) and put it on PATH, or say' \
            'where it is: PYTHON=/path/to/python3.13 make env'
fi
# The folder counts too: a virtual environment cannot be moved.
wanted=$({ pwd; "$python" --version; sha256sum envs/install.sh envs/*.txt pyproject.toml; } | sha256sum)
if [[ -f $stamp && $(<"$stamp") == "$wanted" ]]; then
    exit 0
fi

export PYTHONNOUSERSITE=1 PYTHONSAFEPATH=1 PIP_DISABLE_PIP_VERSION_CHECK=1

stage() { # stage <what> <command...>: run it and say how long it took
    local start=$SECONDS
    printf '==> %s\n' "$1"
    "${@:2}"
    printf '    %s: %d s\n' "$1" $((SECONDS - start))
}

debian_packages() {
    local missing=() package install answer sudo=()
    while read -r package; do
        [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true) == installed ]] ||
            missing+=("$package")
    done < <(sed 's/#.*//; /^[[:space:]]*$/d' "${debian[@]}")
    if ((${#missing[@]} == 0)); then
        return
    fi
    install=(apt-get install --yes --no-install-recommends "${missing[@]}")
    if ((EUID != 0)); then
        printf 'Debian packages are missing, and installing them needs root:\n\n'
        printf '    sudo apt-get update && sudo %s\n\n' "${install[*]}"
        [[ -t 0 ]] || die 'Run this, then again what you ran.'
        read -r -p 'Run it now? [y/N] ' answer
        [[ $answer == [yY]* ]] || die 'Nothing was installed.'
        sudo=(sudo)
    else
        printf 'Installing as root: %s\n' "${missing[*]}"
    fi
    "${sudo[@]}" apt-get update
    "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive "${install[@]}"
}

virtual_environment() {
    local options=()
    # One that works and is of this Python is kept: installing into it is faster.
    if [[ -x $venv/bin/pip && $("$venv/bin/python" --version) == $("$python" --version) ]]; then
        return
    fi
    if [[ $way == debian ]]; then
        options=(--system-site-packages)
    fi
    "$python" -m venv --clear "${options[@]}" "$venv" ||
        die "$python cannot make virtual environments; on Debian and Ubuntu its package" \
            'python3-venv is missing. See docs/install.md.'
}

python_packages() {
    local compiler=()
    # The finite element model is compiled when it is first used.
    if [[ -z ${CC:-} && -z $(type -P cc gcc clang) ]]; then
        printf '    no C compiler here: the one in the wheel ziglang is installed\n'
        compiler=(--requirement envs/requirements-compiler.txt)
    fi
    # pip would compile the packages with one core, which takes longer than all the rest; compileall
    # uses all. Not compiled here, they would be anew by every job where PYTHONDONTWRITEBYTECODE is set.
    "$venv/bin/python" -m pip install --quiet --prefer-binary --no-compile --requirement "$lock" \
        "${compiler[@]}"
    # A file that is meant for another Python does not compile, and is no error.
    "$venv/bin/python" -m compileall -q -j 0 "$venv"/lib/python3*/site-packages >/dev/null || true
}

project() {
    "$venv/bin/python" -m pip install --quiet --no-deps --no-build-isolation --editable .
}

check() {
    "$venv/bin/python" - <<'PYTHON'
import snakemake
import torch

from regional_lv.mechanics import dolfinx_api

build = "with CUDA" if torch.version.cuda else "CPU build"
print(f"    dolfinx {dolfinx_api.dolfinx.__version__}, torch {torch.__version__} ({build}), "
      f"snakemake {snakemake.__version__}")
PYTHON
}

if [[ $way == debian ]]; then
    printf "Debian 12: its own dolfinx, for /usr/bin/python3.\n"
    stage 'Debian packages' debian_packages
else
    printf 'Wheels for %s, %s; nothing is installed as root.\n' "$python" "$("$python" --version)"
fi
stage 'virtual environment' virtual_environment
stage 'Python packages' python_packages
stage 'the project itself' project
stage 'check' check
printf '%s\n' "$wanted" | tee "$stamp" >"$venv/.stamp" # with packages on top, or without
printf 'Environment ready in %d s.\n' "$SECONDS"
