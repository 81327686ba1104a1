#!/usr/bin/env bash
# Slurm on one machine, to try out `gic bench --on slurm`: Debian's packages, one node with all its cores.
#
#   apt-get install slurmctld slurmd munge slurm-client
#   scripts/slurm_local.sh start FOLDER     needs root; FOLDER keeps configuration, state and logs
#   . FOLDER/environment                    for sbatch, squeue, scancel in this shell
#   scripts/slurm_local.sh stop FOLDER      ends the daemons that it started
set -euo pipefail
command=${1:-} folder=$(realpath -m "${2:-/tmp/gic-slurm}")

need() {
  for program in munged slurmctld slurmd sbatch; do
    command -v "$program" >/dev/null || {
      echo "slurm_local: $program is missing: apt-get install slurmctld slurmd munge slurm-client" >&2
      exit 3
    }
  done
  [ "$(id -u)" = 0 ] || { echo "slurm_local: run it as root" >&2; exit 3; }
}

configuration() {
  local host cores memory
  host=$(hostname -s) cores=$(nproc) memory=$(($(sed -n 's/MemTotal: *\([0-9]*\) kB/\1/p' /proc/meminfo) / 1024))
  cat <<CONF
ClusterName=gic
SlurmctldHost=$host(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
ReturnToService=2
SlurmUser=root
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
SlurmctldPort=16817
SlurmdPort=16818
MpiDefault=none
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores RealMemory=$memory State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
}

start() {
  need
  mkdir -p "$folder"/{state,spool}
  # munge wants its key and folders to be its own.
  chmod 755 "$folder"
  [ -f "$folder/munge.key" ] || head -c 1024 /dev/urandom > "$folder/munge.key"
  chmod 400 "$folder/munge.key"
  configuration > "$folder/slurm.conf"
  echo "export SLURM_CONF=$folder/slurm.conf" > "$folder/environment"
  . "$folder/environment"
  munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
    --log-file="$folder/munged.log" --seed-file="$folder/munged.seed"
  slurmctld -f "$SLURM_CONF"
  slurmd -f "$SLURM_CONF"
  for _ in $(seq 50); do
    if sinfo --noheader --format=%T 2>/dev/null | grep -q '^idle\|^mix\|^alloc'; then
      echo "Slurm is up: . $folder/environment"
      return
    fi
    sleep 0.2
  done
  echo "slurm_local: the node does not come up; see $folder/*.log" >&2
  exit 1
}

stop() {
  for daemon in slurmd slurmctld munged; do
    [ -f "$folder/$daemon.pid" ] && kill "$(cat "$folder/$daemon.pid")" 2>/dev/null || true
  done
}

case $command in
  start | stop) "$command" ;;
  *) sed -n '2,8s/^# \{0,1\}//p' "$0"; exit 2 ;;
esac
