#!/usr/bin/env bash
# A Slurm of one node on this machine, from Debian's packages: for trying `corf bench submit --slurm` and for its check in CI. Needs root.
#
#   tools/slurm_local.sh start    install what is missing, write /etc/slurm, start munge, slurmctld and slurmd, wait until the node is idle
#   tools/slurm_local.sh stop     stop them
set -euo pipefail

stop() {
    for name in slurmd slurmctld munged; do
        pkill -x "$name" || true
    done
}

start() {
    if ! command -v slurmctld >/dev/null || ! command -v munged >/dev/null; then
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq slurm-wlm munge >/dev/null
    fi
    stop
    local host cores memory_mb
    host=$(hostname -s)
    cores=$(nproc)
    memory_mb=$(($(awk '/MemTotal/ { print $2 }' /proc/meminfo) / 1024 - 512))
    mkdir -p /etc/slurm /var/spool/slurmctld /var/spool/slurmd /run/munge /var/log/munge
    cat >/etc/slurm/slurm.conf <<CONF
ClusterName=local
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
StateSaveLocation=/var/spool/slurmctld
SlurmdSpoolDir=/var/spool/slurmd
SlurmctldPidFile=/run/slurmctld.pid
SlurmdPidFile=/run/slurmd.pid
SlurmctldLogFile=/var/log/slurmctld.log
SlurmdLogFile=/var/log/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
ReturnToService=2
JobRequeue=1
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores RealMemory=$memory_mb State=UNKNOWN
PartitionName=main Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
    printf 'CgroupPlugin=cgroup/v1\nCgroupAutomount=yes\n' >/etc/slurm/cgroup.conf
    chown -R munge: /etc/munge /run/munge /var/log/munge /var/lib/munge
    su -s /bin/sh munge -c munged
    slurmctld -c
    slurmd
    for _ in $(seq 30); do
        sinfo -h -o %T 2>/dev/null | grep -q idle && return
        sleep 1
    done
    echo "slurm_local.sh: the node did not become idle within 30 s; see /var/log/slurmctld.log and /var/log/slurmd.log" >&2
    tail -5 /var/log/slurmctld.log /var/log/slurmd.log >&2
    exit 1
}

case "${1:-}" in
    start) start ;;
    stop) stop ;;
    *) echo "usage: tools/slurm_local.sh start|stop" >&2; exit 2 ;;
esac
