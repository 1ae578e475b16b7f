#!/usr/bin/env bash
# Run a study on a SLURM of one node, through profiles/slurm, and once without it; the tables have to
# be the same. Installs Debian 12's slurm-wlm and munge, and starts their daemons for this test alone:
# with a configuration, a key and ports of its own, no systemd, no cgroups, no accounting. Called by
# `make test-slurm` as root. Arguments: a configuration in place of config/smoke.yaml, and targets in
# place of the whole study. Copies of the project are in .slurm-test; the run without SLURM is kept
# there and continued, that with SLURM is made anew each time.
set -eu -o pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

config=${1:-config/smoke.yaml}
targets=("${@:2}")
copies=$PWD/.slurm-test
packages=(slurm-wlm munge)

die() {
    printf '%s\n' "$@" >&2
    exit 1
}

((EUID == 0)) || die 'The daemons of SLURM need root. Run: sudo make test-slurm'
(. /etc/os-release && [[ ${ID:-} == debian && ${VERSION_ID:-} == 12 ]]) ||
    die 'This test is for Debian 12, whose SLURM it installs.'
python -c 'import snakemake_executor_plugin_slurm' 2>/dev/null ||
    die 'The Python package snakemake-executor-plugin-slurm is missing. Run: make env'

missing=()
for package in "${packages[@]}"; do
    [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true) == installed ]] ||
        missing+=("$package")
done
if ((${#missing[@]})); then
    printf '==> installing as root with apt: %s\n' "${missing[*]}"
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -qq --yes --no-install-recommends "${missing[@]}" \
        >/dev/null
fi

# ----------------------------------------------------------------------- the cluster

# Jobs look for it in Debian's place: the executor plugin takes SLURM_CONF from their environment.
conf=/etc/slurm/slurm.conf
if [[ -L $conf && ! -e $conf && $(readlink "$conf") == /tmp/slurm-test.* ]]; then
    rm "$conf" # what a killed run left
fi
[[ ! -e $conf && ! -L $conf ]] || die "$conf exists: this machine has a SLURM of its own." \
    'Run on another machine; this test changes no cluster that is there.'
state=$(mktemp -d /tmp/slurm-test.XXXXXX)
daemons=()
running=

shut_down() {
    trap - EXIT INT TERM
    if [[ -n $running ]]; then
        kill "$running" 2>/dev/null || true # it submits nothing more
    fi
    if ((${#daemons[@]} == 3)); then
        scancel --user="$(id -un)" || true
        for _ in {1..30}; do
            [[ -n $(squeue --noheader 2>/dev/null) ]] || break
            sleep 1
        done
    fi
    if [[ -n $running ]]; then
        kill -KILL "$running" 2>/dev/null || true # rather than wait for its next look at its jobs
        wait "$running" 2>/dev/null || true
    fi
    # In the reverse order; these are the processes that this script started.
    for ((i = ${#daemons[@]} - 1; i >= 0; i--)); do
        kill "${daemons[i]}" 2>/dev/null || true
        wait "${daemons[i]}" 2>/dev/null || true
    done
    rm -rf "$conf" "$state"
}
trap shut_down EXIT
trap 'exit 1' INT TERM

start() { # start <name> <command...>: run a daemon in the background, its messages in a file
    # In a session of its own: what interrupts this script must not end it before its jobs.
    setsid "${@:2}" >"$state/$1.out" 2>&1 &
    daemons+=($!)
}

within() { # within <seconds> <what> <command...>: wait until it succeeds
    for ((i = 0; i < $1; i++)); do
        if "${@:3}" >/dev/null 2>&1; then
            return
        fi
        sleep 1
    done
    tail -n 20 "$state"/*.out "$state"/*.log >&2 || true
    die "$2 did not come up within $1 s, see above."
}

idle() {
    [[ $(sinfo --noheader --format=%T) == idle ]]
}

host=$(hostname -s)
cores=${CORES:-2}
memory=$(awk '/^MemTotal/ { print int($2 / 1024 * 0.9) }' /proc/meminfo)
install -d -m 700 "$state/spool" "$state/ctld"
install -m 400 <(head -c 128 /dev/urandom) "$state/munge.key"
cat >"$state/slurm.conf" <<CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$state/munge.socket
CredType=cred/munge
StateSaveLocation=$state/ctld
SlurmdSpoolDir=$state/spool
SlurmctldPidFile=$state/slurmctld.pid
SlurmdPidFile=$state/slurmd.pid
SlurmctldLogFile=$state/slurmctld.log
SlurmdLogFile=$state/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
# What takes more memory than it asked for is killed, as on a real cluster.
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=2
JobAcctGatherParams=OverMemoryKill
AccountingStorageType=accounting_storage/none
# Without accounting, squeue has to know of jobs that have ended.
MinJobAge=86400
ReturnToService=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores RealMemory=$memory
PartitionName=main Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
ln -s "$state/slurm.conf" "$conf"
start munged munged --foreground --force --socket="$state/munge.socket" \
    --key-file="$state/munge.key" --pid-file="$state/munged.pid" --seed-file="$state/munged.seed" \
    --log-file="$state/munged.log"
within 20 munged munge --no-input --socket="$state/munge.socket"
start slurmctld slurmctld -D
start slurmd slurmd -D -N "$host"
within 60 'the node' idle
printf '==> SLURM %s, one node with %s cores\n' "$(sinfo --version | cut -d' ' -f2)" "$cores"

# ----------------------------------------------------------------------- the two runs

copy() { # copy <name>: the project's files as they are now
    mkdir -p "$copies/$1"
    git ls-files -z --cached --others --exclude-standard |
        tar --create --null --ignore-failed-read --files-from - | tar --extract --directory "$copies/$1"
}

study() { # study <name> <arguments...>: run the study there
    printf '==> %s: %s\n' "$1" "$config"
    # In the background, because a trap waits for what runs in the foreground. Nobody else uses the
    # copies, and a lock would outlive an interrupted run.
    (
        cd "$copies/$1"
        exec python -m snakemake --nolock --configfile "$config" "${@:2}" -- "${targets[@]}"
    ) &
    running=$!
    wait "$running"
    running=
}

started=$SECONDS
copy local
study local --cores "$cores"
local_s=$((SECONDS - started))
rm -rf "$copies/slurm"
copy slurm
started=$SECONDS
study slurm --profile profiles/slurm --slurm-status-command squeue \
    --slurm-init-seconds-before-status-checks 5
printf 'Without SLURM %d s (less if it was continued), with SLURM %d s.\n' \
    "$local_s" $((SECONDS - started))
jobs=$(squeue --states=all --noheader --format=%T | sort | uniq -c | awk '{ print $1, $2 }' | paste -sd,)
printf 'Jobs of SLURM: %s\n' "$jobs"
[[ -n $jobs ]] || die 'No job went through SLURM.'
name=$(sed -n 's/^study: *//p' "$config")
python -m tests.workflow.same "$copies/local/results/$name" "$copies/slurm/results/$name"
