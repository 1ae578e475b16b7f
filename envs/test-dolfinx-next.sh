#!/usr/bin/env bash
# Run the physics tests with the dolfinx of Debian 13 (0.9), in a chroot in .dolfinx-next that is
# made once and kept. Called by `make test-dolfinx-next`. Arguments are for pytest and take the
# place of tests/physics.
set -eu -o pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

suite=trixie
root=$PWD/.dolfinx-next
# All from Debian: a second source of Python packages would be a second thing that can differ.
packages=(
    python3-dolfinx libopenblas0-pthread gcc libc6-dev python3-dev
    python3-gmsh python3-h5py python3-jsonschema python3-meshio python3-numpy python3-pandas
    python3-pytest python3-scipy python3-torch python3-yaml
)

die() {
    printf '%s\n' "$@" >&2
    exit 1
}

((EUID == 0)) || die 'A chroot needs root. Run: sudo make test-dolfinx-next'
command -v debootstrap >/dev/null ||
    die 'debootstrap is missing. Run: apt-get update && apt-get install debootstrap'
# Mounts live in a namespace of their own: they end with this script, however it ends, and nobody
# who removes the chroot can reach the machine through them.
if [[ -z ${DOLFINX_NEXT_NAMESPACE:-} ]]; then
    unshare --mount true ||
        die 'This machine does not let root mount (a container without CAP_SYS_ADMIN?).' \
            'Run on another machine, or start the container as a privileged one.'
    DOLFINX_NEXT_NAMESPACE=1 exec unshare --mount --propagation private "envs/${0##*/}" "$@"
fi

inside() { # inside <command...>: run it in the chroot, without what points into this machine
    chroot "$root" env --unset=PYTHONPATH --unset=VIRTUAL_ENV --unset=TMPDIR \
        HOME=/root LC_ALL=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin "$@"
}

# Whatever mirror this machine uses will have the other release too.
mirror() {
    local release
    release=$(. /etc/os-release && printf '%s' "${VERSION_CODENAME:-}")
    apt-get indextargets --format '$(CODENAME) $(COMPONENT) $(REPO_URI)' 'Created-By: Packages' |
        awk -v release="$release" '$1 == release && $2 == "main" { print $3; exit }'
}

if [[ ! -f $root/.bootstrapped ]]; then
    uri=$(mirror)
    [[ -n $uri ]] || die 'apt knows no mirror of this Debian release. Run: apt-get update'
    printf '==> Debian %s in %s\n' "$suite" "${root##*/}"
    rm -rf --one-file-system "$root" # what an interrupted run left
    debootstrap --variant=minbase "$suite" "$root" "$uri" >"$root.log" 2>&1 ||
        die "$(tail -n 20 "$root.log")" "debootstrap failed, see above and $root.log"
    mv "$root.log" "$root/.bootstrapped"
fi
for folder in proc sys dev; do
    mount --rbind "/$folder" "$root/$folder"
done
if [[ $(cat "$root/.packages" 2>/dev/null) != "${packages[*]}" ]]; then
    printf '==> packages\n'
    # A mirror over https may be known to this machine's certificates only.
    if [[ -f /etc/ssl/certs/ca-certificates.crt ]]; then
        mkdir -p "$root/etc/ssl/certs"
        cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
    fi
    inside dpkg --configure -a # what an interrupted run left
    inside apt-get update -q=2
    inside env DEBIAN_FRONTEND=noninteractive apt-get install --yes -q=2 --no-install-recommends \
        "${packages[@]}" >"$root/var/log/packages.log"
    inside apt-get clean
    printf '%s\n' "${packages[*]}" >"$root/.packages"
fi
printf '    chroot ready after %d s, %s\n' "$SECONDS" "$(du -sxh "$root" | cut -f1)"

# Read-only: the tests are those of this very folder, and nothing of the other Python stays in it.
mkdir -p "$root/project"
mount --bind -o ro . "$root/project"
inside python3 -c 'import dolfinx; print(f"==> tests with dolfinx {dolfinx.__version__}")'
inside env --chdir=/project OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1 PYTHONHASHSEED=0 \
    python3 -m pytest -p no:cacheprovider "${@:-tests/physics}"
