#!/bin/sh
# A Slurm of one node on this machine, from Debian's packages and without accounting, to test with:
#   apt-get install slurm-wlm munge
#   sh integrations/slurm/one_node.sh up [cores] | down
# Needs root. Everything it writes is in /run/one-node-slurm, but for a link to it at /etc/slurm/slurm.conf, where
# srun looks inside a job; it ends nothing that it did not start.
set -eu
place=/run/one-node-slurm
usual=/etc/slurm/slurm.conf
cores=${2:-1}

fail() { echo "error: $1" >&2; exit 2; }

down() {
    for daemon in slurmd slurmctld munged; do
        file=$place/$daemon.pid
        [ -s "$file" ] || continue
        process=$(cat "$file")
        [ "$(cat "/proc/$process/comm" 2>/dev/null)" = "$daemon" ] && kill "$process" || true
        for _ in 1 2 3 4 5 6 7 8 9 10; do [ -e "/proc/$process" ] || break; sleep 0.5; done
    done
    [ "$(readlink "$usual" 2>/dev/null)" != "$place/slurm.conf" ] || rm "$usual"
    rm -rf "$place"
}

case ${1:-} in
down) down; echo "down" ; exit ;;
up) ;;
*) fail "say up or down" ;;
esac
[ "$(id -u)" = 0 ] || fail "this needs root"
for program in munged slurmctld slurmd sbatch; do
    command -v "$program" >/dev/null || PATH=$PATH:/usr/sbin command -v "$program" >/dev/null || fail "there is no $program: apt-get install slurm-wlm munge"
done
PATH=$PATH:/usr/sbin
[ ! -e "$place" ] || fail "$place exists: sh $0 down"
[ ! -e "$usual" ] && [ ! -L "$usual" ] || fail "$usual exists: this machine has a Slurm"
mkdir -p "$place/state" "$place/spool" /etc/slurm
chmod 755 "$place"
dd if=/dev/urandom of="$place/munge.key" bs=128 count=1 status=none
chmod 400 "$place/munge.key"
name=$(hostname -s)
memory=$(awk '/MemTotal/ {print int($2 / 1024 * 0.8)}' /proc/meminfo)
cat > "$place/slurm.conf" <<END
ClusterName=one
SlurmctldHost=$name
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$place/munge.socket
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPort=16817
SlurmdPort=16818
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
ReturnToService=2
MpiDefault=none
SwitchType=switch/none
MinJobAge=300
NodeName=$name CPUs=$cores RealMemory=$memory State=UNKNOWN
PartitionName=main Nodes=$name Default=YES MaxTime=INFINITE State=UP
END
ln -s "$place/slurm.conf" "$usual"
munged --force --key-file "$place/munge.key" --socket "$place/munge.socket" --pid-file "$place/munged.pid" \
    --log-file "$place/munged.log" --seed-file "$place/munged.seed"
slurmctld
slurmd
for _ in $(seq 60); do
    sinfo --noheader --format %T 2>/dev/null | grep -q idle && { echo up; exit; }
    sleep 0.5
done
tail -n 5 "$place"/*.log >&2
down
fail "the node did not come up"
