#!/usr/bin/env bash
# Make the environment: Debian packages, a virtual environment in .venv, the project in it.
# Does nothing if .venv was made from the same files and in the same place. Called by `make env`, and
# with the argument `test` by `make test`, whose Debian packages come on top.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

venv=.venv
stamp=$venv/.stamp${1:+-$1}
debian=(envs/debian-packages.txt ${1:+"envs/debian-packages-$1.txt"})
# The folder counts too: a virtual environment cannot be moved.
wanted=$({ pwd; /usr/bin/python3 --version; sha256sum envs/{install.sh,requirements.txt} "${debian[@]}" pyproject.toml; } | sha256sum)
if [[ -f $stamp && $(<"$stamp") == "$wanted" ]]; then
    exit 0
fi

export PYTHONNOUSERSITE=1 PIP_DISABLE_PIP_VERSION_CHECK=1

stage() { # stage <what> <command...>: run it and say how long it took
    local start=$SECONDS
    printf '==> %s\n' "$1"
    "${@:2}"
    printf '    %s: %d s\n' "$1" $((SECONDS - start))
}

debian_packages() {
    local missing=() package command
    while read -r package; do
        [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true) == installed ]] ||
            missing+=("$package")
    done < <(sed 's/#.*//; /^[[:space:]]*$/d' "${debian[@]}")
    if ((${#missing[@]} == 0)); then
        return
    fi
    command=(apt-get install --yes --no-install-recommends "${missing[@]}")
    if ((EUID == 0)); then
        apt-get update
        DEBIAN_FRONTEND=noninteractive "${command[@]}"
    elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
        sudo -n apt-get update
        sudo -n env DEBIAN_FRONTEND=noninteractive "${command[@]}"
    else
        printf 'Debian packages are missing, and installing them needs root. Run this, then again\n'
        printf 'what you ran:\n\n    sudo %s\n\n' "${command[*]}"
        exit 1
    fi
}

virtual_environment() {
    # One that works is kept: installing into it is faster than starting anew.
    if ! "$venv/bin/pip" --version >/dev/null 2>&1; then
        # Debian's dolfinx belongs to Debian's own Python, whatever comes first on PATH.
        /usr/bin/python3 -m venv --clear --system-site-packages "$venv"
    fi
}

python_packages() {
    "$venv/bin/python" -m pip install --quiet --requirement envs/requirements.txt
}

project() {
    "$venv/bin/python" -m pip install --quiet --no-deps --no-build-isolation --editable .
}

check() {
    "$venv/bin/python" - <<'PYTHON'
import dolfinx
import gmsh
import snakemake
import torch

import regional_lv

print(f"    dolfinx {dolfinx.__version__}, gmsh {gmsh.__version__}, torch {torch.__version__}, "
      f"snakemake {snakemake.__version__}")
PYTHON
}

if ! command -v dpkg-query >/dev/null; then
    printf 'This is not Debian. Make the environments from envs/*.yaml with conda instead\n'
    printf '(snakemake --software-deployment-method conda, with PYTHONPATH=src).\n'
    exit 1
fi
stage 'Debian packages' debian_packages
stage 'virtual environment' virtual_environment
stage 'Python packages' python_packages
stage 'the project itself' project
stage 'check' check
printf '%s\n' "$wanted" >"$stamp"
printf 'Environment ready in %d s.\n' "$SECONDS"
