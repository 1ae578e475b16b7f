#!/usr/bin/env bash
# Install from wheels and run the physics tests as an unprivileged user of a bare Debian 13: Python
# and its venv, make, and nothing else. The chroot .wheel-test is made once and kept. Called by
# `make test-wheel`. With the argument `quick` it runs `make quick` there instead; other arguments are
# for pytest and take the place of tests/physics.
set -eu -o pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

suite=trixie
root=$PWD/.wheel-test
packages=python3,python3-venv,ca-certificates,make

die() {
    printf '%s\n' "$@" >&2
    exit 1
}

((EUID == 0)) || die 'A chroot needs root. Run: sudo make test-wheel'
command -v debootstrap >/dev/null ||
    die 'debootstrap is missing. Run: apt-get update && apt-get install debootstrap'
# Mounts live in a namespace of their own: they end with this script, however it ends, and nobody
# who removes the chroot can reach the machine through them.
if [[ -z ${WHEEL_TEST_NAMESPACE:-} ]]; then
    unshare --mount true ||
        die 'This machine does not let root mount (a container without CAP_SYS_ADMIN?).' \
            'Run on another machine, or start the container as a privileged one.'
    WHEEL_TEST_NAMESPACE=1 exec unshare --mount --propagation private "envs/${0##*/}" "$@"
fi

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
    debootstrap --variant=minbase --include="$packages" "$suite" "$root" "$uri" >"$root.log" 2>&1 ||
        die "$(tail -n 20 "$root.log")" "debootstrap failed, see above and $root.log"
    mv "$root.log" "$root/.bootstrapped"
    chroot "$root" useradd --create-home user
fi
for folder in proc sys dev; do
    mount --rbind "/$folder" "$root/$folder"
done
# pip works there as here: with the same settings, indexes and certificates.
settings=()
while read -r setting; do
    settings+=("$setting")
done < <(env | grep '^PIP_' || true)
for file in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/xdg/pip /etc/ssl/certs/ca-certificates.crt; do
    if [[ -e $file ]]; then
        mkdir -p "$root${file%/*}"
        cp -RL --no-target-directory "$file" "$root$file"
    fi
done
if [[ -f ~/.config/pip/pip.conf ]]; then
    mkdir -p "$root/home/user/.config/pip"
    cp ~/.config/pip/pip.conf "$root/home/user/.config/pip/"
fi
mkdir -p "$root/home/user/project"
# Files that Git knows, as they are now; .venv there is kept.
git ls-files -z | tar --create --null --files-from - | tar --extract --directory "$root/home/user/project"
chroot "$root" chown -R user:user /home/user

inside() { # inside <command...>: run it in the project there, as the user
    chroot --userspec=user:user "$root" env --ignore-environment --chdir=/home/user/project \
        "${settings[@]}" HOME=/home/user LC_ALL=C.UTF-8 PATH=/usr/bin:/bin \
        OMP_NUM_THREADS=1 PYTHONHASHSEED=0 "$@"
}

inside make env
if [[ ${1:-} == quick ]]; then
    inside make quick
else
    inside .venv/bin/python -m pytest -p no:cacheprovider "${@:-tests/physics}"
fi
printf 'The chroot has %s, of which the environment %s.\n' \
    "$(du -sxh "$root" | cut -f1)" "$(du -sxh "$root/home/user/project/.venv" | cut -f1)"
